//! Options derived from their schema.

use super::*;
use schemars::JsonSchema;
use serde_json::json;

/// Methods of summation.
#[derive(JsonSchema)]
#[schemars(rename_all = "snake_case")]
#[allow(dead_code)]
enum Way {
    Auto,
    #[schemars(extend("x-bare" = 0.5))]
    Single(f64),
}

#[derive(JsonSchema)]
#[schemars(rename_all = "snake_case")]
#[allow(dead_code)]
enum Word {
    One,
    TwoWords,
}

#[derive(JsonSchema)]
#[allow(dead_code)]
struct Light {
    #[schemars(extend("x-file" = true))]
    path: String,
    scale: Option<f64>,
}

#[derive(JsonSchema)]
#[schemars(rename_all = "snake_case")]
#[allow(dead_code)]
enum Blur {
    #[schemars(extend("x-nameless" = true))]
    Sigma(f64),
    #[schemars(extend("x-flag" = "psf", "x-file" = true))]
    Image(String),
    Lines {
        per_mm: f64,
        #[schemars(extend("x-flag" = "lines"))]
        count: Option<f64>,
    },
}

#[derive(JsonSchema)]
#[allow(dead_code)]
struct Noise {
    full_e: f64,
    read_e: f64,
}

#[derive(JsonSchema)]
#[allow(dead_code)]
struct Inner {
    light_deg: f64,
}

/// Options of a test.
#[derive(JsonSchema)]
#[schemars(extend("x-examples" = "nacre test"))]
#[allow(dead_code)]
struct Options {
    /// Wavelength.
    #[schemars(extend("x-aliases" = ["wavelength"]))]
    wavelength_nm: Option<f64>,
    #[schemars(extend("x-unset" = "auto"))]
    center: Option<[f64; 2]>,
    corners: [[f64; 2]; 4],
    way: Way,
    word: Word,
    deep: bool,
    light: Option<Light>,
    #[schemars(extend("x-expand" = true))]
    blur: Blur,
    soft: Option<Blur>,
    #[schemars(extend("x-list" = true))]
    noise: Option<Noise>,
    #[schemars(extend("x-inline" = true))]
    settings: Inner,
    #[schemars(default = "yes")]
    accelerate: bool,
    #[schemars(default = "pair", extend("x-short" = true))]
    turn: [f64; 2],
}

fn yes() -> bool {
    true
}

fn pair() -> [f64; 2] {
    [1.0, 2.0]
}

fn fields() -> Fields {
    Fields::of(schemars::schema_for!(Options).to_value())
}

fn value(name: &str, text: &str) -> Result<Value, String> {
    fields().list.iter().find(|f| f.name() == name).unwrap().value(text)
}

#[test]
fn names_follow_from_keys() {
    let names: Vec<String> = fields().list.iter().map(Field::name).collect();
    let all = ["wavelength-nm", "center", "corners", "way", "word", "deep", "light", "light-scale"];
    let more =
        ["blur-sigma", "psf", "blur-lines-per-mm", "lines", "soft", "noise", "light-deg", "no-accelerate", "turn"];
    assert_eq!(names, [&all[..], &more].concat());
    assert_eq!(fields().text(EXAMPLES), "nacre test");
    let all = fields();
    let nm = all.list.iter().find(|f| f.name() == "wavelength-nm").unwrap();
    assert_eq!((nm.placeholder().as_str(), nm.aliases()), ("NM", vec!["wavelength".to_owned()]));
}

#[test]
fn texts_become_values_of_the_schema() {
    assert_eq!(value("wavelength-nm", "680").unwrap(), json!(680.0));
    assert_eq!(value("center", "auto").unwrap(), Value::Null);
    assert_eq!(value("center", "1.5,2").unwrap(), json!([1.5, 2.0]));
    assert_eq!(value("center", "3x4").unwrap(), json!([3.0, 4.0]));
    assert_eq!(value("corners", "0,0,1,0,1,1,0,1").unwrap()[2], json!([1.0, 1.0]));
    assert_eq!(value("way", "auto").unwrap(), json!("auto"));
    assert_eq!(value("way", "single").unwrap(), json!({ "single": 0.5 }));
    assert_eq!(value("way", "single=0.25").unwrap(), json!({ "single": 0.25 }));
    assert_eq!(value("word", "two-words").unwrap(), json!("two_words"));
    for (name, text) in
        [("center", "1"), ("center", "1,2,3"), ("wavelength-nm", "NaN"), ("way", "triple=1"), ("word", "three")]
    {
        assert!(value(name, text).is_err(), "{name} {text}");
    }
    assert!(value("word", "three").unwrap_err().contains("one|two-words"));
}

#[test]
fn variants_have_flags_of_their_own() {
    let all = fields().list;
    let named = |name: &str| all.iter().find(|f| f.name() == name).unwrap();
    assert!(named("blur-sigma").excludes(named("psf")) && named("psf").excludes(named("lines")));
    assert!(!named("lines").excludes(named("blur-lines-per-mm")) && !named("turn").excludes(named("noise")));
    assert!(named("psf").is_file() && !named("blur-sigma").is_file());
    let mut options = json!({});
    for (name, text) in
        [("blur-lines-per-mm", "50"), ("lines", "3"), ("soft", "0.5"), ("noise", "20000,8"), ("turn", "75")]
    {
        named(name).put(&mut options, named(name).value(text).unwrap());
    }
    let wanted = json!({ "blur": { "lines": { "per_mm": 50.0, "count": 3.0 } }, "soft": { "sigma": 0.5 },
        "noise": { "full_e": 20000.0, "read_e": 8.0 }, "turn": [75.0, 2.0] });
    assert_eq!(options, wanted);
    for (name, text) in [("turn", "75,x"), ("turn", ""), ("noise", "1"), ("noise", "1,2,3"), ("soft", "hard")] {
        assert!(named(name).value(text).is_err(), "{name} {text}");
    }
}

#[test]
fn values_are_put_where_they_belong() {
    let mut options = json!({});
    for field in fields().list.iter().filter(|f| f.path[0] == "light") {
        field.put(&mut options, json!(field.name()));
        assert_eq!(field.get(&options).unwrap(), &json!(field.name()));
    }
    assert_eq!(options, json!({ "light": { "path": "light", "scale": "light-scale" } }));
}

#[test]
fn options_of_requests_have_no_flag() {
    #[derive(JsonSchema)]
    #[allow(dead_code)]
    struct Request {
        samples: usize,
        #[schemars(extend("x-request" = true))]
        text: Option<String>,
    }
    let fields = Fields::of(schemars::schema_for!(Request).to_value());
    assert_eq!(fields.list.iter().map(Field::name).collect::<Vec<_>>(), ["samples"]);
}
