//! Web page of `nacre serve`, embedded in the binary: paths, contents and content types.
//!
//! The page loads nothing from other servers. It runs under the content security policy in [`POLICY`].

mod standalone;

use sha2::{Digest, Sha256};
use std::sync::LazyLock;

pub use standalone::standalone;

/// A file of the page.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Asset {
    /// Its content.
    pub bytes: &'static [u8],
    /// Value of the `Content-Type` header.
    pub content_type: &'static str,
}

/// `Content-Security-Policy` of the page: no inline code, no external resources.
pub const POLICY: &str = "default-src 'self'; img-src 'self' blob: data:; style-src 'self'; script-src 'self'; \
                          connect-src 'self'; object-src 'none'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'";

const HTML: &str = "text/html; charset=utf-8";
const SCRIPT: &str = "text/javascript; charset=utf-8";
const STYLE: &str = "text/css; charset=utf-8";
const IMAGE: &str = "image/svg+xml";
const PHOTO: &str = "image/jpeg";

/// One row of the table: path, content type, file in `page/`.
macro_rules! row {
    ($path:literal, $content_type:expr, $file:literal) => {
        ($path, Asset { bytes: include_bytes!(concat!("../page/", $file)), content_type: $content_type })
    };
    ($file:literal, $content_type:expr) => {
        (
            concat!("/assets/", $file),
            Asset { bytes: include_bytes!(concat!("../page/", $file)), content_type: $content_type },
        )
    };
}

/// All paths of the page and their assets.
pub const ASSETS: &[(&str, Asset)] = &[
    row!("/", HTML, "index.html"),
    row!("/display", HTML, "display.html"),
    row!("icon.svg", IMAGE),
    row!("base.css", STYLE),
    row!("display.css", STYLE),
    row!("layout.css", STYLE),
    row!("pages.css", STYLE),
    row!("aids.js", SCRIPT),
    row!("api.js", SCRIPT),
    row!("app.js", SCRIPT),
    row!("assetreports.js", SCRIPT),
    row!("bench.js", SCRIPT),
    row!("boardsheet.js", SCRIPT),
    row!("calibrate.js", SCRIPT),
    row!("card.js", SCRIPT),
    row!("calibrated.js", SCRIPT),
    row!("calibratelight.js", SCRIPT),
    row!("calibratepanel.js", SCRIPT),
    row!("charts.js", SCRIPT),
    row!("controls.js", SCRIPT),
    row!("dial.js", SCRIPT),
    row!("display.js", SCRIPT),
    row!("dom.js", SCRIPT),
    row!("feedback.js", SCRIPT),
    row!("format.js", SCRIPT),
    row!("legend.js", SCRIPT),
    row!("mapview.js", SCRIPT),
    row!("mapcolors.js", SCRIPT),
    row!("mapcompare.js", SCRIPT),
    row!("mapcontrast.js", SCRIPT),
    row!("mapdecor.js", SCRIPT),
    row!("mapfigure.js", SCRIPT),
    row!("mapkeys.js", SCRIPT),
    row!("maplayer.js", SCRIPT),
    row!("mapmeasure.js", SCRIPT),
    row!("mapshapes.js", SCRIPT),
    row!("mapspage.js", SCRIPT),
    row!("mapvalues.js", SCRIPT),
    row!("mapviewer.js", SCRIPT),
    row!("palettes.js", SCRIPT),
    row!("tiles.js", SCRIPT),
    row!("naming.js", SCRIPT),
    row!("new.js", SCRIPT),
    row!("outcome.js", SCRIPT),
    row!("palette.js", SCRIPT),
    row!("patterns.js", SCRIPT),
    row!("pictures.js", SCRIPT),
    row!("flashform.js", SCRIPT),
    row!("lutform.js", SCRIPT),
    row!("operationform.js", SCRIPT),
    row!("picker.js", SCRIPT),
    row!("pixelchart.js", SCRIPT),
    row!("plan.js", SCRIPT),
    row!("planform.js", SCRIPT),
    row!("preview.js", SCRIPT),
    row!("remedy.js", SCRIPT),
    row!("render.js", SCRIPT),
    row!("rendering.js", SCRIPT),
    row!("report.js", SCRIPT),
    row!("gallery.jpg", PHOTO),
    row!("scenecamera.js", SCRIPT),
    row!("scenedoc.js", SCRIPT),
    row!("scenedraft.js", SCRIPT),
    row!("sceneedit.js", SCRIPT),
    row!("sceneparts.js", SCRIPT),
    row!("scenetree.js", SCRIPT),
    row!("result.js", SCRIPT),
    row!("results.js", SCRIPT),
    row!("service.js", SCRIPT),
    row!("session.js", SCRIPT),
    row!("sessions.js", SCRIPT),
    row!("stage.js", SCRIPT),
    row!("steps.js", SCRIPT),
    row!("theme.js", SCRIPT),
    row!("trash.js", SCRIPT),
    row!("upload.js", SCRIPT),
    row!("standalone.js", SCRIPT),
    row!("comparing.js", SCRIPT),
    row!("finding.js", SCRIPT),
    row!("layer.js", SCRIPT),
    row!("painter.js", SCRIPT),
    row!("parsed.js", SCRIPT),
    row!("pointing.js", SCRIPT),
    row!("ruler.js", SCRIPT),
    row!("study.js", SCRIPT),
    row!("turntable.js", SCRIPT),
    row!("zip.js", SCRIPT),
    row!("shaders.js", SCRIPT),
    row!("turning.js", SCRIPT),
    row!("view.js", SCRIPT),
    row!("viewer.js", SCRIPT),
    row!("webgpu.js", SCRIPT),
    row!("wgsl.js", SCRIPT),
    row!("wizard.js", SCRIPT),
];

/// Asset at a path, if any.
pub fn asset(path: &str) -> Option<Asset> {
    ASSETS.iter().find(|(known, _)| *known == path).map(|(_, asset)| *asset)
}

/// A document of the page (`/` or `/display`), with [`version`] inserted into the paths of its assets.
pub fn document(path: &str) -> Option<String> {
    let document = asset(path).filter(|asset| asset.content_type == HTML)?;
    let versioned = format!("\"/assets/{}/", version());
    Some(String::from_utf8_lossy(document.bytes).replace("\"/assets/", &versioned))
}

/// Asset at a path that contains [`version`]. Its contents never change, so browsers may cache it indefinitely.
pub fn versioned(path: &str) -> Option<Asset> {
    let name = path.strip_prefix("/assets/")?.strip_prefix(version())?.strip_prefix('/')?;
    asset(&format!("/assets/{name}"))
}

/// Sixteen hexadecimal digits that change with any asset.
pub fn version() -> &'static str {
    static VERSION: LazyLock<String> = LazyLock::new(|| {
        let mut hasher = Sha256::new();
        for (path, asset) in ASSETS {
            hasher.update(path);
            hasher.update(asset.bytes);
        }
        hasher.finalize().iter().take(8).map(|byte| format!("{byte:02x}")).collect()
    });
    &VERSION
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;

    /// Texts between `before` and the next quotation mark.
    fn quoted<'a>(text: &'a str, before: &str) -> Vec<&'a str> {
        text.split(before).skip(1).filter_map(|rest| rest.split('"').next()).collect()
    }

    fn text(path: &str) -> &'static str {
        std::str::from_utf8(asset(path).expect(path).bytes).expect(path)
    }

    #[test]
    fn documents_name_assets_that_never_change() {
        for path in ["/", "/display"] {
            let document = document(path).unwrap();
            let assets = quoted(&document, "\"/assets/").len();
            assert_eq!(assets, quoted(text(path), "\"/assets/").len());
            let named: Vec<&str> = quoted(&document, "=\"/assets/");
            assert!(named.len() > 2 && named.iter().all(|name| name.starts_with(version())), "{named:?}");
            for name in named {
                assert!(versioned(&format!("/assets/{name}")).is_some(), "{name}");
            }
        }
        assert_eq!(versioned("/assets/0000000000000000/app.js"), None);
        assert_eq!(versioned("/assets/app.js"), None);
        assert_eq!(document("/assets/app.js"), None);
        assert_eq!(version().len(), 16);
    }

    #[test]
    fn everything_named_is_there() {
        let mut named = BTreeSet::new();
        for page in ["/", "/display"] {
            named.extend(quoted(text(page), "src=\"").into_iter().map(str::to_owned));
            named.extend(quoted(text(page), "<link rel=\"stylesheet\" href=\"").into_iter().map(str::to_owned));
            named.extend(quoted(text(page), "<link rel=\"icon\" href=\"").into_iter().map(str::to_owned));
        }
        for (path, found) in ASSETS.iter().filter(|(_, a)| a.content_type == SCRIPT) {
            let (now, later) = (quoted(text(path), "from \"./"), quoted(text(path), "import(\"./"));
            assert!(found.bytes.len() > 100, "{path} is empty");
            named.extend(now.into_iter().chain(later).map(|file| format!("/assets/{file}")));
        }
        for (path, _) in ASSETS.iter().filter(|(_, a)| a.content_type == STYLE) {
            named.extend(quoted(text(path), "url(\"").into_iter().map(|file| format!("/assets/{file}")));
        }
        // The first module of an exported view.
        named.insert("/assets/standalone.js".into());
        assert!(named.len() > 25, "only {named:?} were found");
        for path in &named {
            assert!(asset(path).is_some(), "{path} is named but not embedded");
        }
        for (path, _) in ASSETS.iter().filter(|(path, _)| path.starts_with("/assets/")) {
            assert!(named.contains(*path), "{path} is embedded but never named");
        }
    }

    #[test]
    fn every_file_is_embedded_once() {
        let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/page");
        assert_eq!(std::fs::read_dir(folder).expect(folder).count(), ASSETS.len());
        let paths: BTreeSet<_> = ASSETS.iter().map(|(path, _)| path).collect();
        assert_eq!(paths.len(), ASSETS.len());
    }

    #[test]
    fn nothing_comes_from_outside_or_inline() {
        for (path, _) in ASSETS.iter().filter(|(_, a)| a.content_type != PHOTO) {
            let text = text(path).replace("http://www.w3.org/", "");
            for forbidden in ["http://", "https://", "@import", "<style", " style=\"", "eval(", "innerHTML"] {
                assert!(!text.contains(forbidden), "{path} has {forbidden}");
            }
            assert!(!text.contains("<script>"), "{path} has an inline script");
        }
    }

    #[test]
    fn unknown_paths_lead_nowhere() {
        for path in ["", "/assets/", "/assets/nothing.js", "/index.html", "/assets/../src/lib.rs"] {
            assert_eq!(asset(path), None, "{path}");
        }
    }
}
