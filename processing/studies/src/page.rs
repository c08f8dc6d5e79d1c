//! `index.html`: a self-contained page with all charts of a folder.

use nacre_plot::svg::escape;
use std::fmt::Write;

/// A picture on the page.
pub(super) struct Entry {
    pub name: String,
    pub title: String,
    pub text: String,
    /// Conditions of the measurement; empty for computed pictures.
    pub measured: String,
    /// Files besides the picture, relative to the folder.
    pub files: Vec<String>,
}

const STYLE: &str = "\
:root { color-scheme: light dark; --page: #f4f6f8; --ink: #1c2430; --soft: #56606e; --card: #ffffff; --line: #d9dee5; --link: #005a9c; }
@media (prefers-color-scheme: dark) { :root { --page: #14181e; --ink: #e6eaf0; --soft: #a3adba; --card: #1d232b; --line: #333c48; --link: #7cc0f5; } }
body { margin: 0 auto; max-width: 1320px; padding: 24px; background: var(--page); color: var(--ink); font: 16px/1.5 system-ui, sans-serif; }
h1 { margin: 0 0 4px; } h2 { margin: 0 0 6px; font-size: 1.2rem; } p { margin: 0 0 12px; max-width: 75ch; }
a { color: var(--link); } nav { margin: 12px 0 20px; display: flex; flex-wrap: wrap; gap: 6px 16px; } .soft { color: var(--soft); }
section { background: var(--card); border: 1px solid var(--line); border-radius: 8px; padding: 18px; margin: 0 0 20px; }
img { display: block; width: 100%; height: auto; background: #fff; border-radius: 4px; }";

/// Renders the page as HTML.
pub(super) fn html(entries: &[Entry]) -> String {
    let mut body = String::from("<h1>Charts: speed, accuracy, stability</h1>\n");
    body.push_str("<nav>");
    for e in entries {
        let _ = write!(body, "<a href=\"#{0}\">{1}</a>", e.name, escape(&e.title));
    }
    body.push_str("</nav>\n");
    for e in entries {
        let (name, title) = (&e.name, escape(&e.title));
        let _ = writeln!(body, "<section id=\"{name}\"><h2>{title}</h2>\n<p>{}</p>", escape(&e.text));
        let _ = writeln!(body, "<a href=\"{name}/{name}.svg\"><img src=\"{name}/{name}.svg\" alt=\"{title}\"></a>");
        let links: Vec<String> =
            e.files.iter().map(|f| format!("<a href=\"{f}\">{}</a>", f.rsplit('/').next().unwrap_or(f))).collect();
        let _ = writeln!(body, "<p class=\"soft\">{}<br>{}</p></section>", links.join(" · "), escape(&e.measured));
    }
    format!(
        "<!doctype html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"><meta name=\"viewport\" \
         content=\"width=device-width\"><title>Nacre: charts</title>\n<style>\n{STYLE}\n</style></head>\n<body>\n{body}</body></html>\n"
    )
}
