//! Tests of whole folders of charts.

use super::*;
use nacre_base::Error;
use nacre_base::progress::Silent;
use std::path::Path;

/// Terms of the exponential series, with names that need escaping.
pub(super) fn study() -> Study {
    const X: [f64; 5] = [0.01, 0.1, 1.0, 3.0, 10.0];
    Study {
        name: "series",
        group: "examples",
        title: "exp(x) < \"∞\" & more".into(),
        question: "How many terms, < or > than 5?".into(),
        knob: Axis::linear("terms", ""),
        stress: Axis::log("x", ""),
        error: Axis::log("relative error", "%"),
        time: Axis::log("time", "s"),
        predicted: "next term",
        settings: (1..=6).map(|n| Setting::new("Taylor, plain", format!("{n} terms, \"exact\""), n.into())).collect(),
        scenes: X.map(Scene::new).to_vec(),
        reference: 2,
        run: Box::new(|setting, scene, seed| {
            let x = X[scene];
            let sum = (0..=setting).rev().fold(0.0, |sum, k| 1.0 + x * sum / (k + 1) as f64);
            // The last scene masks everything.
            let error = (scene < 4).then(|| (sum / x.exp() - 1.0).abs() * (1.0 + (seed % 100) as f64 / 1000.0));
            let wrong = if scene == 3 { 0.2 } else { 0.0 };
            Ok(Outcome {
                error,
                seconds: (setting + 1) as f64,
                masked: 0.25 * scene as f64,
                wrong,
                predicted: Some(0.1),
            })
        }),
    }
}

pub(super) fn records_without_time(records: &[Record]) -> Vec<(usize, usize, usize, Option<f64>, f64)> {
    let mut all: Vec<_> =
        records.iter().map(|r| (r.run, r.scene, r.setting, r.outcome.error, r.outcome.masked)).collect();
    all.sort_by(|a, b| a.partial_cmp(b).unwrap());
    all
}

fn request<'a>(out: &'a Path, studies: &'a [Study]) -> Request<'a> {
    Request { out, force: false, format: ChartFormat::default(), plan: Plan::new(3, "test"), studies, pictures: &[] }
}

#[test]
fn tables_and_pictures_are_well_formed_and_agree() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("charts");
    let studies = [study()];
    let charted = chart(&request(&out, &studies), &Silent).unwrap();
    assert_eq!(charted, catalogue(&out).unwrap());
    let read = |name: &str| std::fs::read_to_string(out.join(name)).unwrap();
    charted.charts[0].files.iter().for_each(|f| assert!(out.join(f).is_file(), "{f}"));
    let summary: Summary = serde_json::from_str(&read("series/series.json")).unwrap();
    assert_eq!(summary.points.len(), 30);
    // Cost rises and error falls with every term, so all points with an error are on the front.
    assert!(summary.points.iter().all(|p| p.front == (p.scene < 4) && p.runs == 5));
    assert_csv(&read("series/series.csv"), &summary);
    let svg = read("series/series.svg");
    assert!(svg.contains("exp(x) &lt; &quot;∞&quot; &amp; more") && svg.contains("relative error (%)"));
    let png = image::open(out.join("series/series.png")).unwrap();
    assert_eq!(png.width(), 1920);
    assert!(read("index.html").contains("series/series.svg") && read("index.html").contains("seed 3"));
    assert!(std::fs::read(out.join("series/series.pdf")).unwrap().starts_with(b"%PDF-"));
}

/// Charts for a journal have its column width and no titles; existing measurements are reused.
#[test]
fn charts_fit_the_columns_of_a_journal() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("charts");
    let studies = [study()];
    chart(&request(&out, &studies), &Silent).unwrap();
    let raw = std::fs::read(out.join("series/raw.jsonl")).unwrap();
    for (width, mm) in [(Width::Single, 85.0), (Width::Double, 178.0)] {
        let format = ChartFormat { titles: false, width };
        chart(&Request { format, ..request(&out, &studies) }, &Silent).unwrap();
        let svg = std::fs::read_to_string(out.join("series/series.svg")).unwrap();
        assert!(svg.contains(&format!("width=\"{mm:.3}mm\"")) && !svg.contains("Error, and where"), "{svg}");
        // 300 pixels per inch.
        let png = image::open(out.join("series/series.png")).unwrap();
        assert!((f64::from(png.width()) - mm / 25.4 * 300.0).abs() < 2.0, "{}", png.width());
        let pdf = std::fs::read(out.join("series/series.pdf")).unwrap();
        let text = String::from_utf8_lossy(&pdf);
        let width = text.split("/MediaBox [0 0 ").nth(1).and_then(|t| t.split(' ').next()).unwrap();
        assert!((width.parse::<f64>().unwrap() - mm / 25.4 * 72.0).abs() < 0.01, "{width}");
    }
    assert_eq!(std::fs::read(out.join("series/raw.jsonl")).unwrap(), raw);
}

/// Every line has the header's fields (quoted commas count correctly) and the numbers of the summary.
fn assert_csv(csv: &str, summary: &Summary) {
    let fields = |line: &str| {
        let (mut fields, mut quoted) = (vec![String::new()], false);
        for c in line.chars() {
            match c {
                '"' => quoted = !quoted,
                ',' if !quoted => fields.push(String::new()),
                c => fields.last_mut().unwrap().push(c),
            }
        }
        fields
    };
    let mut lines = csv.lines();
    let header = fields(lines.next().unwrap());
    let column = header.iter().position(|h| h == "error_median [%]").unwrap();
    for (line, point) in lines.by_ref().zip(&summary.points) {
        let values = fields(line);
        assert_eq!(values.len(), header.len(), "{line}");
        assert_eq!(values[column].parse().ok(), point.error.map(|e| e.median), "{line}");
    }
    assert_eq!(csv.lines().count(), 1 + summary.points.len());
}

#[test]
fn folders_of_others_are_left_alone_and_charts_add_up() {
    let folder = tempfile::tempdir().unwrap();
    let studies = [study()];
    std::fs::write(folder.path().join("thesis.txt"), "x").unwrap();
    let refused = chart(&request(folder.path(), &studies), &Silent);
    assert!(matches!(refused, Err(Error::Input { .. })));
    let out = folder.path().join("charts");
    chart(&request(&out, &studies), &Silent).unwrap();
    let second = [Study { name: "other", ..study() }];
    chart(&request(&out, &second), &Silent).unwrap();
    let names: Vec<String> = catalogue(&out).unwrap().charts.into_iter().map(|c| c.name).collect();
    assert_eq!(names, ["series", "other"]);
    // Another seed is refused, unless forced.
    let other = Request { plan: Plan::new(4, "test"), ..request(&out, &second) };
    assert!(chart(&other, &Silent).is_err());
    let before = std::fs::read(out.join("other/raw.jsonl")).unwrap();
    chart(&Request { force: true, ..other }, &Silent).unwrap();
    assert_ne!(std::fs::read(out.join("other/raw.jsonl")).unwrap(), before);
}

/// Names on the command line and of folders are unique and plain; every numeric parameter has at least five settings.
#[test]
fn studies_are_as_they_must_be() {
    let studies = polarimetry::studies(Effort::Quick);
    let mut names: Vec<&str> =
        studies.iter().map(|s| s.name).chain(polarimetry::pictures().iter().map(|p| p.name)).collect();
    let all = names.len();
    names.sort_unstable();
    names.dedup();
    assert_eq!(names.len(), all);
    for s in &studies {
        assert!(s.name.bytes().all(|b| b.is_ascii_lowercase() || b == b'-'), "{}", s.name);
        assert!(s.scenes.len() >= 5 && s.reference < s.scenes.len(), "{}", s.name);
        assert!(s.knob.scale == Scale::Names || s.settings.len() >= 5, "{}", s.name);
        assert_eq!(s.settings.iter().filter(|s| s.default).count(), 1, "{}", s.name);
    }
}

/// The same seed gives the same scene and error; another seed gives another error.
#[test]
fn every_study_repeats() {
    for s in polarimetry::studies(Effort::Quick) {
        let run = |seed| (s.run)(0, 1, seed).unwrap();
        let (a, b, other) = (run(5), run(5), run(6));
        assert_eq!((a.error, a.masked, a.wrong, a.predicted), (b.error, b.masked, b.wrong, b.predicted), "{}", s.name);
        assert_ne!(a.error, other.error, "{}", s.name);
    }
}
