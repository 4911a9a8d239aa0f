//! The page's files, inside the executable.

/// A file: path, type, content.
pub(crate) struct File {
    pub(crate) path: &'static str,
    pub(crate) kind: &'static str,
    pub(crate) content: &'static str,
}

macro_rules! files {
    ($($path:literal $kind:literal $file:literal;)+) => {
        /// All but plotly's script, which the report's crate carries.
        pub(crate) const FILES: &[File] = &[ $( File {
            path: $path, kind: $kind, content: include_str!(concat!("../page/", $file)),
        }, )+ ];
    };
}

files! {
    "/" "text/html; charset=utf-8" "index.html";
    "/style.css" "text/css; charset=utf-8" "style.css";
    "/link.js" "text/javascript; charset=utf-8" "link.js";
    "/charts.js" "text/javascript; charset=utf-8" "charts.js";
    "/views.js" "text/javascript; charset=utf-8" "views.js";
    "/steer.js" "text/javascript; charset=utf-8" "steer.js";
    "/app.js" "text/javascript; charset=utf-8" "app.js";
}
