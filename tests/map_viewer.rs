//! The map viewer in headless Chromium: values, colours, profile, regions, comparison, figures and keys.

#![allow(clippy::unwrap_used, clippy::print_stdout)]

use crate::map_tiles::{SIZE, maps};
use nacre_tests::Place;
use nacre_tests::chromium::Browser;
use nacre_tests::http::Service;
use serde_json::{Value, json};

const CANVAS: &str = "document.querySelector('#result-map')";

struct Page {
    browser: Browser,
    service: Service,
    id: String,
    place: Place,
}

impl Page {
    /// Maps in the viewer.
    fn open() -> Option<Self> {
        let browser = Browser::start()?;
        let place = Place::with_bench("", "camera = { width = 64, height = 48 }");
        let service = Service::start(&place, &[]);
        let id = maps(&place, &service, 0.0);
        let page = Self { browser, service, id, place };
        page.visit();
        Some(page)
    }

    fn visit(&self) {
        self.browser.open("about:blank");
        self.browser.open(&format!("http://{}/#/maps/{}", self.service.address, self.id));
        self.settled();
    }

    /// Waits until all tiles that are seen are there and drawn.
    fn settled(&self) {
        self.browser.until(&format!(
            "{CANVAS}.view.zoom > 0 && {CANVAS}.view.due === 0 && [...{CANVAS}.viewer.stores.values()].every((s) => s.idle && s.kept.size > 0)"
        ));
    }

    /// Values of a map from its NumPy array.
    fn values(&self, map: &str) -> Vec<f32> {
        let array = self.service.get(&format!("/api/v1/reconstructions/{}/maps/{map}.npy", self.id)).expect(200).body;
        let values = &array[array.len() - 4 * SIZE[0] * SIZE[1]..];
        values.as_chunks::<4>().0.iter().map(|b| f32::from_le_bytes(*b)).collect()
    }

    fn text(&self, css: &str) -> String {
        self.browser.run(&format!("return document.querySelector('{css}').innerText")).as_str().unwrap().to_owned()
    }

    /// The mouse at the centres of pixels: moves, pressed between the first and the last one if `drag`.
    fn mouse(&self, pixels: &[[usize; 2]], drag: bool) {
        self.browser.run(&format!("{CANVAS}.scrollIntoView({{ block: 'center' }})"));
        let origin = json!({ "element-6066-11e4-a52e-4f735466cecf": self.browser.element("#result-map") });
        let mut actions = vec![];
        for (k, [x, y]) in pixels.iter().enumerate() {
            let at = self.browser.run(&format!(
                "const c = {CANVAS}; const [x, y] = c.view.toCanvas([{x} + 0.5, {y} + 0.5]); return [x - c.clientWidth / 2, y - c.clientHeight / 2]"
            ));
            let [x, y] = [0, 1].map(|k| at[k].as_f64().unwrap().round());
            actions.push(json!({ "type": "pointerMove", "duration": 0, "x": x, "y": y, "origin": origin }));
            if drag && k == 0 {
                actions.push(json!({ "type": "pointerDown", "button": 0 }));
            }
        }
        if drag {
            actions.push(json!({ "type": "pointerUp", "button": 0 }));
        }
        let mouse = json!({ "actions": [{ "type": "pointer", "id": "mouse", "actions": actions }] });
        self.browser.call("POST", "/actions", &mouse);
    }

    /// Keys while the map has the focus.
    fn keys(&self, keys: &[&str]) {
        self.browser.run(&format!("{CANVAS}.focus()"));
        self.press(keys);
    }

    fn press(&self, keys: &[&str]) {
        let press = |kind: &str, key: &&str| json!({ "type": kind, "value": key });
        let all: Vec<Value> = keys.iter().flat_map(|k| [press("keyDown", k), press("keyUp", k)]).collect();
        let keyboard = json!({ "actions": [{ "type": "key", "id": "keys", "actions": all }] });
        self.browser.call("POST", "/actions", &keyboard);
    }

    /// Colour of the canvas at a pixel of the map.
    fn color(&self, [x, y]: [usize; 2]) -> [i64; 3] {
        self.settled();
        let found = self.browser.run(&format!(
            "const c = {CANVAS}; const [x, y] = c.view.toCanvas([{x} + 0.5, {y} + 0.5]).map((v) => Math.floor(v * devicePixelRatio));
             return [...c.getContext('2d').getImageData(x, y, 1, 1).data].slice(0, 3)"
        ));
        [0, 1, 2].map(|k| found[k].as_i64().unwrap())
    }

    fn errors(&self) -> Vec<Value> {
        let said = self.browser.call("POST", "/se/log", &json!({ "type": "browser" }));
        said.as_array().unwrap().iter().filter(|entry| entry["level"] == "SEVERE").cloned().collect()
    }

    fn accessible(&self, state: &str) {
        for theme in ["light", "dark"] {
            self.browser.run(&format!("document.documentElement.dataset.theme = '{theme}'"));
            self.browser.until("document.getAnimations().every((a) => !(a instanceof CSSTransition))");
            let found = self.browser.run(include_str!("accessible.js"));
            assert_eq!(found[0], json!([]), "{state}, {theme}");
        }
    }
}

/// A valid pixel in the middle of the map, and a masked one if there is any.
fn pixels(values: &[f32]) -> ([usize; 2], Option<[usize; 2]>) {
    let at = |i: usize| [i % SIZE[0], i / SIZE[0]];
    let middle = SIZE[0] * SIZE[1] / 2 + SIZE[0] / 3;
    let valid = (middle..values.len()).find(|i| values[*i].is_finite()).unwrap();
    (at(valid), values.iter().position(|v| !v.is_finite()).map(at))
}

#[test]
fn values_are_shown_with_their_uncertainty() {
    let Some(page) = Page::open() else { return };
    let (orientation, sigma) = (page.values("orientation"), page.values("sigma"));
    let ([x, y], masked) = pixels(&orientation);
    let value = f64::from(orientation[y * SIZE[0] + x]).to_degrees();
    let error = f64::from(sigma[y * SIZE[0] + x]).to_degrees();
    let digits = (1.0 - error.log10().floor()).max(0.0) as usize;
    let words = format!("x {x}  y {y}   Orientation {value:.digits$} ± {error:.digits$}°");
    page.mouse(&[[x, y]], false);
    page.browser.until(&format!("document.querySelector('#map-value').textContent === '{words}'"));
    if let Some([x, y]) = masked {
        page.mouse(&[[x, y]], false);
        page.browser.until("document.querySelector('#map-value').textContent.endsWith('Orientation masked')");
    }
    // The keyboard moves from pixel to pixel, and the page announces each value.
    page.mouse(&[[x, y], [x, y]], true);
    page.browser.until(&format!("{CANVAS}.view.picked?.x === {x}"));
    page.browser.run(&format!("{CANVAS}.focus()"));
    page.browser.call(
        "POST",
        "/actions",
        &json!({ "actions": [{ "type": "key", "id": "keys", "actions": [
            { "type": "keyDown", "value": "\u{E008}" }, { "type": "keyDown", "value": "\u{E014}" },
            { "type": "keyUp", "value": "\u{E014}" }, { "type": "keyUp", "value": "\u{E008}" } ] }] }),
    );
    page.browser.until(&format!("{CANVAS}.view.picked?.x === {}", x + 1));
    page.browser.until(&format!(
        "document.querySelector('#map-value').textContent.startsWith('x {}  y {y}   Orientation ')",
        x + 1
    ));
    page.accessible("a pixel");
    assert!(page.errors().is_empty(), "{:?}", page.errors());
}

#[test]
fn colours_follow_range_percentiles_and_palette() {
    let Some(page) = Page::open() else { return };
    let browser = &page.browser;
    let period = page.values("period");
    let ([x, y], _) = pixels(&period);
    let value = f64::from(period[y * SIZE[0] + x]);
    browser.click("[data-key=period]");
    browser.until("document.querySelector('.contrast .bars')?.getAttribute('d').length > 100");
    browser.until("document.querySelector('#range-percentiles').value === '1,99'");
    let ends =
        || ["low", "high"].map(|end| browser.run(&format!("return {CANVAS}.viewer.layerOf().{end}")).as_f64().unwrap());
    let mut sorted: Vec<f32> = period.iter().copied().filter(|v| v.is_finite()).collect();
    sorted.sort_by(f32::total_cmp);
    let quantile = |q: f64| f64::from(sorted[(q * (sorted.len() - 1) as f64).round() as usize]);
    let close = |a: f64, b: f64| (a - b).abs() < 0.01 * (quantile(0.99) - quantile(0.01));
    assert!(close(ends()[0], quantile(0.01)) && close(ends()[1], quantile(0.99)), "{:?}", ends());
    browser.choose("palette", "grey");
    let level = |[low, high]: [f64; 2]| (255.0 * ((value - low) / (high - low)).clamp(0.0, 1.0)).round() as i64;
    let shown = page.color([x, y]);
    assert!((shown[0] - level(ends())).abs() <= 1 && shown[0] == shown[2], "{shown:?} {}", level(ends()));
    browser.choose("range-percentiles", "0,100");
    let wide = ends();
    assert!(close(wide[0], quantile(0.0)) && close(wide[1], quantile(1.0)));
    assert!((page.color([x, y])[0] - level(wide)).abs() <= 1);
    // Typed, by the keyboard on the histogram, and by keys of the map.
    browser.run(
        "const e = document.querySelector('#range-high'); e.value = 2 * e.value; e.dispatchEvent(new Event('change'))",
    );
    assert!((ends()[1] / (2.0 * wide[1]) - 1.0).abs() < 1e-3);
    let before = ends();
    browser.run("document.querySelectorAll('.contrast .limit')[1].focus()");
    page.press(&["\u{E012}"]);
    assert!(ends()[1] < before[1] && ends()[0] == before[0]);
    assert_eq!(browser.run("return document.activeElement.getAttribute('role')"), "slider", "the focus is lost");
    let before = ends();
    page.keys(&["]"]);
    assert!(ends()[1] - ends()[0] > before[1] - before[0]);
    // A range without width is refused at its field.
    browser
        .run("const e = document.querySelector('#range-high'); e.value = -1e9; e.dispatchEvent(new Event('change'))");
    assert_eq!(browser.run("return document.querySelector('#range-high').getAttribute('aria-invalid')"), "true");
    // Every palette by name, each with other colours.
    browser.choose("range-percentiles", "1,99");
    let mut colors = vec![];
    for palette in ["viridis", "cividis", "inferno", "grey", "blue_red"] {
        browser.choose("palette", palette);
        colors.push(page.color([x, y]));
    }
    colors.sort_unstable();
    colors.dedup();
    assert_eq!(colors.len(), 5, "{colors:?}");
    browser.both("map-period");
    // Directions have cyclic palettes, and P goes from one to the next.
    page.keys(&["1"]);
    browser.until("document.querySelector('#palette').value === 'cyclic'");
    let cyclic = page.color([x, y]);
    page.keys(&["p"]);
    browser.until("document.querySelector('#palette').value === 'hsv'");
    assert_ne!(page.color([x, y]), cyclic);
    page.accessible("colours");
    assert!(page.errors().is_empty(), "{:?}", page.errors());
}

#[test]
fn lines_and_regions_are_measured() {
    let Some(page) = Page::open() else { return };
    let browser = &page.browser;
    let period = page.values("period");
    browser.click("[data-key=period]");
    browser.click("[data-key=line]");
    page.mouse(&[[40, 50], [60, 50], [139, 50]], true);
    browser.until("document.querySelector('#profile-chart path.fit')");
    assert!(page.text("#measurement h2").eq_ignore_ascii_case("Profile of Period"), "{}", page.text("#measurement h2"));
    let said = browser.run("return document.querySelector('#profile-chart').getAttribute('aria-label')");
    let count: usize = said.as_str().unwrap().split_once(": ").unwrap().1.split(' ').next().unwrap().parse().unwrap();
    assert!((99..=101).contains(&count), "{said}");
    let folder = tempfile::tempdir().unwrap();
    browser.downloads_to(folder.path());
    browser.run("document.querySelector('#measure-csv').click()");
    let table = std::fs::read_to_string(browser.downloaded(folder.path(), ".csv")).unwrap();
    let row: Vec<f64> = table.lines().nth(50).unwrap().split(',').take(4).map(|n| n.parse().unwrap()).collect();
    let wanted = f64::from(period[row[2] as usize * SIZE[0] + row[1] as usize]);
    assert!((row[3] / wanted - 1.0).abs() < 1e-5, "{row:?} {wanted}");
    browser.both("map-profile");

    // A rectangle by mouse: its numbers are those of its pixels.
    browser.click("[data-key=rectangle]");
    page.mouse(&[[20, 30], [50, 60], [119, 129]], true);
    browser.until("document.querySelector('#region-chart')");
    let corners = browser.run(&format!("return {CANVAS}.viewer.shapes.shape.corners"));
    let corner = |k: usize, axis: usize| corners[k][axis].as_u64().unwrap() as usize;
    let inside = (corner(0, 1)..corner(1, 1)).flat_map(|y| (corner(0, 0)..corner(1, 0)).map(move |x| y * SIZE[0] + x));
    let part: Vec<f64> = inside.map(|i| f64::from(period[i])).collect();
    assert!((9_600..=10_500).contains(&part.len()), "{corners}");
    let mean = part.iter().sum::<f64>() / part.len() as f64;
    let figure = "document.querySelector('#measurement .figures strong').textContent";
    browser.until(&format!("Math.abs(parseFloat({figure}) / {mean} - 1) < 2e-3"));
    // Its corner moves by keys, one pixel each.
    browser.run("document.querySelector('.shapes circle').focus()");
    page.press(&["\u{E014}"]);
    browser.until(&format!("{CANVAS}.viewer.shapes.shape.corners[0][0] === {}", corner(0, 0) + 1));
    page.accessible("a region");
    browser.both("map-region");

    // A polygon by clicks, without a mouse by its key; Escape removes it.
    browser.click("[data-key=polygon]");
    for place in [[40, 40], [100, 50], [70, 110]] {
        page.mouse(&[place, place], true);
    }
    browser.until("/in the polygon/i.test(document.querySelector('#measurement h2').textContent) && document.querySelectorAll('.shapes circle').length === 3");
    page.keys(&["\u{E00C}"]);
    browser.until("document.querySelector('#measurement').hidden");
    page.keys(&["g"]);
    browser.until(
        "document.querySelectorAll('.shapes circle').length === 3 && !document.querySelector('#measurement').hidden",
    );
    assert!(page.errors().is_empty(), "{:?}", page.errors());
}

#[test]
fn maps_are_compared() {
    let Some(page) = Page::open() else { return };
    let browser = &page.browser;
    let other = maps(&page.place, &page.service, 50_f32.to_radians());
    page.visit();
    let orientation = page.values("orientation");
    let ([_, y], _) = pixels(&orientation);
    let row = |range: std::ops::Range<usize>| range.clone().find(|x| orientation[y * SIZE[0] + x].is_finite()).unwrap();
    let (left, right) = ([row(30..120), y], [row(200..290), y]);
    let before = [left, right].map(|at| page.color(at));
    browser.until(&format!("document.querySelector('#compare-with option[value^=\"{other}\"]')"));
    browser.choose("compare-with", &format!("{other} orientation"));
    browser.until("!document.querySelector('.comparing').hidden && document.querySelector('#map-divider')");
    browser.until(&format!("{CANVAS}.viewer.second()"));
    assert_eq!(page.color(left), before[0]);
    assert_ne!(page.color(right), before[1]);
    // The line moves by keys: everything left of it is the first map.
    browser.run("document.querySelector('#map-divider').focus()");
    page.press(&["\u{E010}"]);
    assert_eq!(browser.run("return document.querySelector('#map-divider').getAttribute('aria-valuenow')"), "100");
    assert_eq!(page.color(right), before[1]);
    page.accessible("comparison");
    // The difference of two offsets is the same everywhere, and the value says it.
    browser.click("[data-key=difference]");
    let [a, b] = [page.color(left), page.color(right)];
    assert!(a.iter().zip(b).all(|(a, b)| (a - b).abs() <= 3), "{a:?} {b:?}");
    page.mouse(&[left], false);
    browser.until("/difference −50\\.\\d*°$|difference 50\\.\\d*°$|difference −50°|difference 50°/.test(document.querySelector('#map-value').textContent)");
    browser.both("map-difference");
    // Both in turn; B changes by hand while it is paused.
    browser.click("[data-key=blink]");
    browser.click("#blink-pause");
    browser.until("document.querySelector('#blink-pause').getAttribute('aria-pressed') === 'true'");
    let first = browser.run(&format!("return {CANVAS}.viewer.compare.state.second"));
    let [one, two] = [0, 1].map(|_| {
        let shown = page.color(left);
        page.keys(&["b"]);
        shown
    });
    assert_eq!(if first == true { two } else { one }, before[0]);
    assert_ne!(one, two);
    browser.choose("compare-with", "");
    assert_eq!(page.color(right), before[1]);
    assert!(page.errors().is_empty(), "{:?}", page.errors());
}

#[test]
fn layers_figures_and_keys() {
    let Some(page) = Page::open() else { return };
    let browser = &page.browser;
    let ([x, y], _) = pixels(&page.values("orientation"));
    let plain = page.color([x, y]);
    page.keys(&["f"]);
    browser.until("document.querySelector('#fade').checked");
    browser.until(&format!("{CANVAS}.viewer.layerOf().fade"));
    assert_ne!(page.color([x, y]), plain, "σ does not fade the pixel");
    page.keys(&["f", "o"]);
    browser.until("document.querySelector('#glyphs').checked");
    browser.both("map-directions");
    // The list of keys opens by ?, holds the focus, and gives it back.
    page.keys(&["?"]);
    browser.until("document.querySelector('dialog.keys[open]')");
    let list = page.text("dialog.keys");
    for words in ["Profile", "next palette", "pixel to pixel"] {
        assert!(list.to_lowercase().contains(&words.to_lowercase()), "no “{words}” in: {list}");
    }
    page.accessible("keys");
    browser.both("map-keys");
    browser.run("document.querySelector('dialog.keys button').focus()");
    page.press(&["\u{E00C}"]);
    browser.until("!document.querySelector('dialog.keys') && document.activeElement.id === 'result-map'");

    // Figures: the SVG has title, unit and scale bar as text, and the PNG has the same proportions.
    browser.click("[data-key=sigma]");
    page.settled();
    browser.until(&format!("{CANVAS}.viewer.layerOf().info.name === 'sigma' && {CANVAS}.viewer.layerOf().high > 0 && {CANVAS}.viewer.layerOf().high < 1"));
    let folder = tempfile::tempdir().unwrap();
    browser.downloads_to(folder.path());
    browser.run("window.scrollTo(0, 0)");
    browser.click("#figure-svg");
    let drawing = std::fs::read_to_string(browser.downloaded(folder.path(), ".svg")).unwrap();
    for part in ["· σ</text>", ">°</text>", " mm</text>", ">masked</text>", "data:image/png;base64,"] {
        assert!(drawing.contains(part), "no {part}");
    }
    browser.click("#figure-png");
    let picture = image::open(browser.downloaded(folder.path(), ".png")).unwrap().to_rgb8();
    let size = |key: &str| -> f64 {
        drawing.split(&format!(" {key}=\"")).nth(1).unwrap().split('"').next().unwrap().parse().unwrap()
    };
    let [width, height] = [size("width"), size("height")];
    assert!((f64::from(picture.width()) / f64::from(picture.height()) - width / height).abs() < 0.01);
    assert_eq!(picture.get_pixel(1, 1).0, [255; 3]);
    assert!(picture.pixels().filter(|p| p.0 != [255; 3]).count() > 10_000);

    browser.click("#figure-pdf");
    let pdf = std::fs::read(browser.downloaded(folder.path(), ".pdf")).unwrap();
    assert_offsets(&pdf);
    assert!(pdf.len() > 5_000);
    // The clipboard gets the PNG.
    browser.permit_clipboard(&format!("http://{}", page.service.address));
    browser.click("#figure-copy");
    browser.until("document.querySelector('.notices').innerText.includes('The figure is copied')");
    let copied = browser.run(
        "return navigator.clipboard.read().then((items) => items[0].getType('image/png')).then((blob) => createImageBitmap(blob))
            .then((bitmap) => [bitmap.width, bitmap.height])",
    );
    assert_eq!(copied, json!([picture.width(), picture.height()]));

    // Maps without a button are in the list.
    browser.choose("map-choice", "period.mask");
    browser.until(&format!("{CANVAS}.viewer.layerOf().info.name === 'period.mask'"));
    page.settled();
    page.accessible("a map of the list");
    browser.both("map-mask");
    assert!(page.errors().is_empty(), "{:?}", page.errors());
}

/// Every object of a PDF lies where its table says.
fn assert_offsets(pdf: &[u8]) {
    let number = |bytes: &[u8]| -> usize { std::str::from_utf8(bytes).unwrap().trim().parse().unwrap() };
    let end = pdf.windows(9).rposition(|w| w == b"startxref").unwrap();
    let table = &pdf[number(pdf[end + 9..].split(|b| *b == b'%').next().unwrap())..end];
    assert!(table.starts_with(b"xref\n0 "));
    let rows: Vec<&[u8]> = table.split(|b| *b == b'\n').filter(|row| row.ends_with(b" n ")).collect();
    assert!(rows.len() > 5);
    for (k, row) in rows.into_iter().enumerate() {
        let object = format!("{} 0 obj\n", k + 1);
        assert!(pdf[number(&row[..10])..].starts_with(object.as_bytes()), "{object}");
    }
}
