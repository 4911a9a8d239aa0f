//! What a run was like: a summary for programs and a self-contained HTML report for people.
//!
//! [`summarise`] makes the figures of a run from its log ([`RunSummary`], the content of `summary.json`);
//! [`report_html`] makes one file that opens anywhere without a network. Nothing is computed here that
//! `metrics` could compute; nothing is left out silently: a figure that cannot be had says why.

mod comparison;
mod decimate;
mod figure;
mod figures;
mod force_budget;
mod html;
mod overlay;
mod page;
mod procedure;
mod published;
mod run;
mod sections;
mod shell;
mod source_figures;
mod study;
mod summary;
mod table;
mod verdict;

pub use comparison::{Compared, comparison_html, comparison_json};
pub use force_budget::{ForceBudget, ForcePart};
pub use html::{ReportOptions, plotly_js, report_html};
pub use overlay::{Overlay, OverlayResult, RecordLoop};
pub use page::{Curve, Plot, Rows, page_html};
pub use procedure::{
    Entry, Procedure, angle_per_rack, assess, assessment_json, assessment_text, procedure_html, signals,
};
pub use published::{PUBLISHED_TRACKING, PublishedTracking, published_for};
pub use study::{StudyColumn, study_html};
pub use summary::{
    LogSummary, LoopFigures, Peaks, RunSummary, ServiceTiming, SolverSummary, Span, TrackingFigures, Trip,
    summarise,
};
pub use table::STATES;
pub use verdict::{Limits, Outcome, Verdict};
