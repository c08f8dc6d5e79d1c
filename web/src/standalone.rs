//! Export of a view as a single HTML file with embedded scripts, styles and data.

use crate::asset;
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use flate2::Compression;
use flate2::write::GzEncoder;
use std::io::Write;

/// Scripts of the viewer. A page opened from disk cannot load module files, so modules are data URLs in an import map.
const MODULES: [&str; 19] = [
    "card",
    "comparing",
    "dom",
    "format",
    "layer",
    "legend",
    "painter",
    "palette",
    "parsed",
    "pointing",
    "ruler",
    "shaders",
    "standalone",
    "turning",
    "turntable",
    "viewer",
    "webgpu",
    "wgsl",
    "zip",
];

const STYLES: [&str; 3] = ["base", "layout", "pages"];

/// Text of a file of the page.
fn text(name: &str) -> String {
    asset(&format!("/assets/{name}")).map(|a| String::from_utf8_lossy(a.bytes).into_owned()).unwrap_or_default()
}

/// Escapes text for HTML, including attribute values.
fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

/// Creates a page that shows a view: title, bytes of `Prepared` (see the daemon's `view`), and query string of the
/// viewer's links.
///
/// # Errors
/// None in practice, because it writes to memory.
pub fn standalone(title: &str, view: &[u8], state: &str) -> std::io::Result<Vec<u8>> {
    let mut packed = GzEncoder::new(vec![], Compression::fast());
    packed.write_all(view)?;
    let data = STANDARD.encode(packed.finish()?);
    let module = |name: &&str| {
        // Modules have bare names in the import map.
        let source = text(&format!("{name}.js"));
        let source = source.replace("from \"./", "from \"nacre/").replace("import(\"./", "import(\"nacre/");
        format!("\"nacre/{name}.js\": \"data:text/javascript;base64,{}\"", STANDARD.encode(source))
    };
    let imports: Vec<String> = MODULES.iter().map(module).collect();
    let styles: String = STYLES.iter().map(|name| text(&format!("{name}.css"))).collect();
    let (title, state, imports) = (escaped(title), escaped(state), imports.join(", "));
    let page = format!(
        "<!doctype html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n\
         <meta name=\"color-scheme\" content=\"light dark\">\n<title>{title} · Nacre</title>\n<style>{styles}</style>\n\
         <script type=\"importmap\">{{\"imports\": {{{imports}}}}}</script>\n</head>\n<body>\n\
         <main id=\"main\" data-title=\"{title}\" data-state=\"{state}\"></main>\n\
         <script type=\"text/plain\" id=\"data\">{data}</script>\n\
         <script type=\"module\">import {{ start }} from \"nacre/standalone.js\"; start();</script>\n</body>\n</html>\n"
    );
    Ok(page.into_bytes())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nothing_is_loaded_and_nothing_breaks_out() {
        let page = standalone("a \"<b>\"", b"1234", "x=\"><script>").expect("memory");
        let page = String::from_utf8(page).expect("text");
        for module in MODULES {
            assert!(!text(&format!("{module}.js")).is_empty(), "{module}");
            let source = text(&format!("{module}.js"));
            for line in source.lines().filter(|l| l.starts_with("import ") || l.contains(" import(")) {
                let from = ["from \"./", "import(\"./"].iter().find_map(|before| line.split(before).nth(1));
                let from = from.and_then(|l| l.split(".js").next()).expect(line);
                assert!(MODULES.contains(&from), "{module} needs {from}");
            }
        }
        assert!(!page.contains("<b>") && !page.contains("\"><script>"));
        assert!(!page.contains("src=") && !page.contains("href="));
    }
}
