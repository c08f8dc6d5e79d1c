//! Web page of `nacre serve`, embedded in the binary: paths, contents and content types.
//!
//! The page loads nothing from other servers. It runs under the content security policy in [`POLICY`].

mod bundle;
mod standalone;

use bundle::Modules;
use flate2::Compression;
use flate2::write::GzEncoder;
use sha2::{Digest, Sha256};
use std::collections::BTreeMap;
use std::io::Write;
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
    row!("begin.css", STYLE),
    row!("picks.css", STYLE),
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
    row!("calibration.js", SCRIPT),
    row!("calibrationoffset.js", SCRIPT),
    row!("calibrationseries.js", SCRIPT),
    row!("calibrationsteps.js", SCRIPT),
    row!("calibratelight.js", SCRIPT),
    row!("calibratepanel.js", SCRIPT),
    row!("charts.js", SCRIPT),
    row!("controls.js", SCRIPT),
    row!("course.js", SCRIPT),
    row!("described.js", SCRIPT),
    row!("flashlights.js", SCRIPT),
    row!("gratings.js", SCRIPT),
    row!("hdrview.js", SCRIPT),
    row!("lutcurves.js", SCRIPT),
    row!("defecttable.js", SCRIPT),
    row!("dial.js", SCRIPT),
    row!("display.js", SCRIPT),
    row!("dom.js", SCRIPT),
    row!("doors.js", SCRIPT),
    row!("feedback.js", SCRIPT),
    row!("format.js", SCRIPT),
    row!("inspect.js", SCRIPT),
    row!("inspection.js", SCRIPT),
    row!("legend.js", SCRIPT),
    row!("lighting.js", SCRIPT),
    row!("limitsform.js", SCRIPT),
    row!("mapview.js", SCRIPT),
    row!("mapcolors.js", SCRIPT),
    row!("mapcompare.js", SCRIPT),
    row!("mapcontrast.js", SCRIPT),
    row!("mapdecor.js", SCRIPT),
    row!("mapfigure.js", SCRIPT),
    row!("mapkeys.js", SCRIPT),
    row!("maplayer.js", SCRIPT),
    row!("mapmeasure.js", SCRIPT),
    row!("mappdf.js", SCRIPT),
    row!("mapshapes.js", SCRIPT),
    row!("mapspage.js", SCRIPT),
    row!("mapvalues.js", SCRIPT),
    row!("mapviewer.js", SCRIPT),
    row!("palettes.js", SCRIPT),
    row!("tiles.js", SCRIPT),
    row!("naming.js", SCRIPT),
    row!("new.js", SCRIPT),
    row!("notify.js", SCRIPT),
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
    row!("presets.js", SCRIPT),
    row!("preview.js", SCRIPT),
    row!("region.js", SCRIPT),
    row!("references.js", SCRIPT),
    row!("remedy.js", SCRIPT),
    row!("render.js", SCRIPT),
    row!("rendering.js", SCRIPT),
    row!("queue.js", SCRIPT),
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
    row!("sessionforms.js", SCRIPT),
    row!("sessions.js", SCRIPT),
    row!("settings.js", SCRIPT),
    row!("sheetpictures.js", SCRIPT),
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

/// A file with the same content in gzip format.
#[derive(Debug)]
pub struct Packed {
    /// The file.
    pub asset: Asset,
    /// Its content in gzip format.
    pub gzip: Vec<u8>,
}

/// File at a path that contains [`version`]: scripts with their modules, and all other assets. Its content never
/// changes, so browsers may cache it indefinitely.
pub fn versioned(path: &str) -> Option<&'static Packed> {
    PACKED.get(path.strip_prefix("/assets/")?.strip_prefix(version())?.strip_prefix('/')?)
}

/// Sixteen hexadecimal digits that change with any file of the page.
pub fn version() -> &'static str {
    static VERSION: LazyLock<String> = LazyLock::new(|| {
        let mut hasher = Sha256::new();
        for (path, file) in PACKED.iter() {
            hasher.update(path);
            hasher.update(file.asset.bytes);
        }
        hasher.finalize().iter().take(8).map(|byte| format!("{byte:02x}")).collect()
    });
    &VERSION
}

/// Modules of the page.
fn modules() -> Modules {
    Modules::read(ASSETS.iter().filter_map(|(path, asset)| {
        let name = path.strip_prefix("/assets/")?.strip_suffix(".js")?;
        Some((name, std::str::from_utf8(asset.bytes).ok()?))
    }))
}

/// Files by name, without the modules that scripts contain.
static PACKED: LazyLock<BTreeMap<String, Packed>> = LazyLock::new(|| {
    let modules = modules();
    let scripts = [modules.page("app"), modules.page("display")].into_iter().flatten();
    let scripts = scripts.map(|(name, text)| {
        let bytes: &'static [u8] = Box::leak(text.into_bytes().into_boxed_slice());
        (format!("{name}.js"), Asset { bytes, content_type: SCRIPT })
    });
    let others = ASSETS.iter().filter(|(path, asset)| asset.content_type != SCRIPT || path.ends_with("/theme.js"));
    let others = others.filter_map(|(path, asset)| Some((path.strip_prefix("/assets/")?.to_owned(), *asset)));
    scripts.chain(others).map(|(name, asset)| (name, Packed { asset, gzip: gzip(asset.bytes) })).collect()
});

fn gzip(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = GzEncoder::new(vec![], Compression::best());
    // Writing to memory cannot fail.
    let _ = encoder.write_all(bytes);
    encoder.finish().unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;

    /// Texts between `before` and the next quotation mark.
    fn quoted<'a>(text: &'a str, before: &str) -> Vec<&'a str> {
        text.split(before).skip(1).filter_map(|rest| rest.split('"').next()).collect()
    }

    pub(crate) fn text(path: &str) -> &'static str {
        std::str::from_utf8(asset(path).expect(path).bytes).expect(path)
    }

    /// Paths and names of all scripts.
    pub(crate) fn scripts() -> impl Iterator<Item = (&'static str, &'static str)> {
        let name = |path: &'static str| Some((path, path.strip_prefix("/assets/")?.strip_suffix(".js")?));
        ASSETS.iter().filter_map(move |(path, _)| name(path))
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
        assert!(versioned("/assets/0000000000000000/app.js").is_none());
        assert!(versioned("/assets/app.js").is_none());
        assert_eq!(document("/assets/app.js"), None);
        assert_eq!(version().len(), 16);
    }

    #[test]
    fn the_viewer_is_loaded_only_for_views() {
        let script = |name: &str| versioned(&format!("/assets/{}/{name}.js", version())).map(|file| file.asset.bytes);
        let app = std::str::from_utf8(script("app").unwrap()).unwrap();
        for later in ["view", "painter", "webgpu"] {
            assert!(!app.contains(&format!("const ${later} = ")), "{later} is in the first script");
            assert!(script(later).is_some(), "{later} has no script");
        }
        assert!(app.len() > 100_000 && script("dom").is_none(), "modules of the first script are not apart");
        assert!(std::str::from_utf8(script("display").unwrap()).unwrap().contains("export { $"));
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
