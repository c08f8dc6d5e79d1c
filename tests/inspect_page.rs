//! Inspection in headless Chromium: from a result to a verdict, a folder with its summary, and the training of limits.

#![allow(clippy::unwrap_used)]

use nacre_tests::chromium::Browser;
use nacre_tests::http::Service;
use nacre_tests::{Place, nacre};
use serde_json::{Value, json};
use std::fs;

/// Ids of sessions begin with this, and end with a digit.
const IDS: &str = "01JQ0000000000000000000";

/// Where the dirt lies, in mm from the middle.
const DIRT_MM: [f64; 2] = [3.0, -2.0];

/// A session with results in the data folder of the service to come.
fn session(place: &Place, name: &str, seed: usize, sample: &str) -> String {
    let id = format!("{IDS}{:03}", seed);
    let bench = format!(
        "seed = {seed}\ncamera = {{ width = 128, height = 128 }}\n[sample]\nkind = \"polygons\"\nseed = 1\nsize_mm = 20.0\n{sample}"
    );
    let plan = format!(
        "kind = \"polarization\"\nsample = \"{name}\"\ncamera = {{ exposure_ms = 15 }}\nreconstruct = {{ operation = \"polarization\" }}\n\
         analyser = {{ angles_deg = [0, 15, 30, 45, 60, 75, 90, 105, 120, 135, 150, 165] }}\n"
    );
    fs::write(place.text("sheet.toml"), bench).unwrap();
    fs::write(place.text("plan.toml"), plan).unwrap();
    let (plan, bench, out) =
        (place.text("plan.toml"), place.text("sheet.toml"), place.text(&format!("data/sessions/{id}")));
    fs::create_dir_all(place.text("data/sessions")).unwrap();
    nacre(["capture", &plan, "--sim", "--bench", &bench, "--out", &out]).expect(0);
    id
}

struct Page {
    browser: Browser,
    service: Service,
    url: String,
}

impl Page {
    /// Chooses samples and the reference on the form, and starts.
    fn order(&self, samples: &[&String], reference: &str) {
        self.browser.until("document.querySelector('#samples input')");
        for id in samples {
            let set = format!(
                "const box = document.querySelector('#samples input[value=\"{id}\"]'); if (!box.checked) box.click();"
            );
            self.browser.run(&set);
        }
        self.browser.choose("reference", reference);
    }

    /// Waits for the verdict of the inspection that was started, and answers with its id.
    fn finished(&self) -> String {
        self.browser.until("location.hash.startsWith('#/result/') && document.querySelector('.inspected')");
        self.text("location.hash").rsplit('/').next().unwrap().to_owned()
    }

    fn text(&self, script: &str) -> String {
        self.browser.run(&format!("return {script}")).as_str().unwrap_or_default().to_owned()
    }

    fn visit(&self, hash: &str) {
        self.browser.open("about:blank");
        self.browser.open(&format!("{}/#/{hash}", self.url));
    }

    fn report(&self, id: &str) -> Value {
        self.service.get(&format!("/api/v1/reconstructions/{id}")).expect(200).json()["report"].clone()
    }

    fn accessible(&self, name: &str) {
        self.browser.until("document.getAnimations().every((a) => !(a instanceof CSSTransition))");
        assert_eq!(self.browser.run(include_str!("accessible.js"))[0], json!([]), "{name}");
    }
}

#[test]
fn sheets_are_inspected_on_the_page() {
    let Some(browser) = Browser::start() else { return };
    let place = Place::with_bench("", "camera = { width = 64, height = 48 }");
    let good = session(&place, "Good sheet", 1, "");
    let training: Vec<String> = ["", "turn_deg = 2.0", "shift_mm = [1.0, -0.5]"]
        .into_iter()
        .enumerate()
        .map(|(k, pose)| session(&place, &format!("Training {k}"), 2 + k, pose))
        .collect();
    let [x, y] = DIRT_MM;
    let planted =
        format!("turn_deg = 1.0\n[[sample.planted]]\nclass = \"dirt\"\nat_mm = [{x:.1}, {y:.1}]\nwidth_mm = 1.0\n");
    let bad = session(&place, "Dirty sheet", 7, &planted);
    let fine = session(&place, "Fine sheet", 8, "turn_deg = -1.5");
    let service = Service::start(&place, &[]);
    let page = Page { url: format!("http://{}", service.address), browser, service };
    let browser = &page.browser;

    // Limits are trained by the good samples.
    page.visit("inspect");
    page.order(&training.iter().take(2).collect::<Vec<_>>(), &good);
    browser.click("[data-key=train]");
    browser.until("document.querySelector('#inspect-start').disabled");
    page.order(&training.iter().collect::<Vec<_>>(), &good);
    page.accessible("form");
    browser.both("inspect-form");
    browser.click("#inspect-start");
    let trained = page.finished();
    assert!(page.report(&trained)["limits"]["threshold"].as_f64().unwrap() > 3.0);
    browser.until("document.querySelector('a[data-download=\"limits.toml\"]')");
    browser.both("inspect-trained");

    // From the page of the dirty sheet's result to its verdict.
    page.visit(&format!("result/{bad}"));
    browser.click("#to-inspect");
    page.order(&[], &good);
    browser.choose("limits", &format!("result:{trained}/limits.toml"));
    browser.click("#inspect-start");
    let inspected = page.finished();
    assert_eq!(page.text("document.querySelector('.inspected').innerText"), "Reject");
    let report = page.report(&inspected);
    let sheet = &report["sheets"][0];
    assert_eq!(sheet["sample"]["name"], "Dirty sheet");
    let devices = [&report["reference"], &sheet["sample"]].map(|o| o["devices"].as_array().unwrap().len());
    assert!(devices.iter().all(|n| *n > 0) && sheet["sample"]["captured_s"].is_u64(), "{report}");
    let row = page.text("document.querySelector('#defects tbody tr').innerText");
    assert!(row.contains("dirt"), "{row}");
    // The position is that of the planted dirt on the sheet.
    let place_of = page.text("document.querySelector('#defects tbody tr').cells[3].innerText").replace('−', "-");
    let found: Vec<f64> = place_of.replace(" mm", "").split(", ").map(|v| v.parse().unwrap()).collect();
    assert!((found[0] - x).hypot(found[1] - y) < 0.3, "{place_of}");
    browser.until(
        "[...document.querySelectorAll('svg.sheet image')].every((i) => i.getAttribute('href')?.startsWith('blob:'))",
    );
    page.accessible("verdict");
    browser.both("inspect-reject");
    // A row marks its defect in both pictures, which show the same part.
    browser.click("#defects tbody tr");
    browser.until("document.querySelectorAll('.defect.marked[data-defect=\"1\"]').length === 2");
    browser.click("[aria-label=Enlarge]");
    let parts = browser.run("return [...document.querySelectorAll('svg.sheet')].map((s) => s.getAttribute('viewBox'))");
    assert!(parts[0] == parts[1] && parts[0] != "0 0 128 128", "{parts}");
    browser.click("[data-key=\"deviation.png\"]");
    browser.until("document.querySelectorAll('svg.sheet image')[1].dataset.file === 'deviation.png'");
    browser.both("inspect-marked");

    // The PDF is downloaded whole.
    let folder = tempfile::tempdir().unwrap();
    browser.downloads_to(folder.path());
    browser.run("document.querySelector('a[data-download=\"report.pdf\"]').click()");
    let pdf = fs::read(browser.downloaded(folder.path(), ".pdf")).unwrap();
    assert!(pdf.starts_with(b"%PDF-1.") && pdf.trim_ascii_end().ends_with(b"%%EOF"));

    // Several samples have a summary, in which the rejected one is shown first.
    page.visit(&format!("inspect/{inspected}"));
    browser.until("document.querySelector('#limits')?.value.startsWith('result:')");
    page.order(&[&fine], &good);
    browser.click("#inspect-start");
    page.finished();
    browser.until(
        "document.querySelectorAll('#batch tbody tr').length === 2 && document.querySelector('#sheet .inspected')",
    );
    let verdicts = browser.run("return [...document.querySelectorAll('#batch tbody tr')].map((r) => [r.cells[0].innerText, r.dataset.verdict]).sort()");
    assert_eq!(verdicts, json!([["Dirty sheet", "reject"], ["Fine sheet", "accept"]]));
    page.accessible("batch");
    browser.both("inspect-batch");
    browser.click("#batch tr[data-verdict=accept]");
    browser.until("document.querySelector('#sheet .inspected').innerText === 'Accept'");

    // Numbers on the form are limits too: dirt of any number is allowed.
    page.visit(&format!("inspect/{inspected}"));
    browser.until("document.querySelector('#limits')?.value.startsWith('result:')");
    browser.choose("limits", "numbers");
    browser.run(
        "for (const input of document.querySelectorAll('#limits-numbers input')) { input.value = input.dataset.key === 'max_area_mm2' ? '30' : ''; }",
    );
    browser.both("inspect-numbers");
    browser.click("#inspect-start");
    let allowed = page.finished();
    assert_eq!(page.text("document.querySelector('.inspected').innerText"), "Accept");
    assert_eq!(page.report(&allowed)["limits_sha256"].as_str().unwrap().len(), 64);
}
