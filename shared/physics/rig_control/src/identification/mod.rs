//! Identification: from periodic tests of an axis to a frequency response with coherence, and from there to
//! the parameters that the controller's compensations need.
//!
//! [`excitation`] makes the tests, [`frequency`] the responses, [`fit`] the parameters. Who runs the tests, on
//! which rig, within which limits, is not decided here. Not for the real-time path: it allocates.
//!
//! Method: periodic excitation, averaged over periods; in closed loop the response between two signals is the
//! ratio of their averages at the excited lines, which feedback does not bias [Pintelon, Schoukens 2012, System
//! Identification: A Frequency Domain Approach, §2.6 and 10.3].

pub mod excitation;
pub mod fit;
pub mod frequency;

pub use excitation::{Excitation, Periodic};
pub use fit::{AxisFit, HubFit, SeriesFit, fit_axis, fit_hub, fit_mass, fit_stiffness};
pub use frequency::{FrequencyResponse, response};
