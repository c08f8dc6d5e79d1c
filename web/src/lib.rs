//! The page and its scripts, embedded in the binary.

/// A file of the page.
#[derive(Clone, Copy, Debug)]
pub struct Asset {
    /// Its contents.
    pub bytes: &'static [u8],
    /// Its media type.
    pub content_type: &'static str,
}

const HTML: &str = "text/html; charset=utf-8";
const SCRIPT: &str = "text/javascript; charset=utf-8";
const STYLE: &str = "text/css; charset=utf-8";
const SVG: &str = "image/svg+xml";

/// Every file by its path.
const ASSETS: &[(&str, &[u8], &str)] = &[
    ("/assets/api.js", include_bytes!("../page/api.js"), SCRIPT),
    ("/assets/app.js", include_bytes!("../page/app.js"), SCRIPT),
    ("/assets/base.css", include_bytes!("../page/base.css"), STYLE),
    ("/assets/bench.js", include_bytes!("../page/bench.js"), SCRIPT),
    ("/assets/controls.js", include_bytes!("../page/controls.js"), SCRIPT),
    ("/assets/dial.js", include_bytes!("../page/dial.js"), SCRIPT),
    ("/assets/display.css", include_bytes!("../page/display.css"), STYLE),
    ("/display", include_bytes!("../page/display.html"), HTML),
    ("/assets/display.js", include_bytes!("../page/display.js"), SCRIPT),
    ("/assets/dom.js", include_bytes!("../page/dom.js"), SCRIPT),
    ("/assets/feedback.js", include_bytes!("../page/feedback.js"), SCRIPT),
    ("/assets/format.js", include_bytes!("../page/format.js"), SCRIPT),
    ("/assets/icon.svg", include_bytes!("../page/icon.svg"), SVG),
    ("/", include_bytes!("../page/index.html"), HTML),
    ("/assets/layout.css", include_bytes!("../page/layout.css"), STYLE),
    ("/assets/legend.js", include_bytes!("../page/legend.js"), SCRIPT),
    ("/assets/mapview.js", include_bytes!("../page/mapview.js"), SCRIPT),
    ("/assets/new.js", include_bytes!("../page/new.js"), SCRIPT),
    ("/assets/pages.css", include_bytes!("../page/pages.css"), STYLE),
    ("/assets/patterns.js", include_bytes!("../page/patterns.js"), SCRIPT),
    ("/assets/pixelchart.js", include_bytes!("../page/pixelchart.js"), SCRIPT),
    ("/assets/plan.js", include_bytes!("../page/plan.js"), SCRIPT),
    ("/assets/planform.js", include_bytes!("../page/planform.js"), SCRIPT),
    ("/assets/preview.js", include_bytes!("../page/preview.js"), SCRIPT),
    ("/assets/report.js", include_bytes!("../page/report.js"), SCRIPT),
    ("/assets/result.js", include_bytes!("../page/result.js"), SCRIPT),
    ("/assets/service.js", include_bytes!("../page/service.js"), SCRIPT),
    ("/assets/session.js", include_bytes!("../page/session.js"), SCRIPT),
    ("/assets/sessions.js", include_bytes!("../page/sessions.js"), SCRIPT),
    ("/assets/stage.js", include_bytes!("../page/stage.js"), SCRIPT),
    ("/assets/steps.js", include_bytes!("../page/steps.js"), SCRIPT),
    ("/assets/theme.js", include_bytes!("../page/theme.js"), SCRIPT),
    ("/assets/upload.js", include_bytes!("../page/upload.js"), SCRIPT),
];

/// The file at a path, `/` for instance.
pub fn asset(path: &str) -> Option<Asset> {
    ASSETS.iter().find(|a| a.0 == path).map(|a| Asset { bytes: a.1, content_type: a.2 })
}
