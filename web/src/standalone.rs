//! Export of a view as a single HTML file with embedded scripts, styles and data.

use crate::{asset, modules};
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use flate2::Compression;
use flate2::write::GzEncoder;
use std::io::Write;

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
    // A page opened from disk cannot load files, so that all modules are in one script.
    let script = modules().whole("standalone");
    let styles: String = STYLES.iter().map(|name| text(&format!("{name}.css"))).collect();
    let (title, state) = (escaped(title), escaped(state));
    let page = format!(
        "<!doctype html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n\
         <meta name=\"color-scheme\" content=\"light dark\">\n<title>{title} · Nacre</title>\n<style>{styles}</style>\n</head>\n<body>\n\
         <main id=\"main\" data-title=\"{title}\" data-state=\"{state}\"></main>\n\
         <script type=\"text/plain\" id=\"data\">{data}</script>\n\
         <script type=\"module\">\n{script}$standalone.start();\n</script>\n</body>\n</html>\n"
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
        for module in ["dom", "painter", "shaders", "webgpu", "wgsl", "zip"] {
            assert!(page.contains(&format!("const ${module} = ")), "{module}");
        }
        assert_eq!(page.matches("</script").count(), 2);
        assert!(!page.contains(" from \"./") && !page.contains("await import("));
        assert!(!page.contains("<b>") && !page.contains("\"><script>"));
        assert!(!page.contains("src=") && !page.contains("href="));
    }
}
