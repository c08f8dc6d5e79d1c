//! Jobs and requests in the formats of earlier versions.

use super::{LightUpload, Spec, UsedResult};
use nacre_capture::plan::Method;
use nacre_polarimetry::{Options, PeriodMethod};
use serde::Deserialize;
use serde_json::{Map, Value};

/// A stored job. Earlier versions named the operation `method`, with options of polarization beside it.
#[derive(Deserialize)]
pub(super) struct Stored {
    id: String,
    #[serde(default)]
    name: String,
    #[serde(default, alias = "method")]
    operation: Method,
    options: Option<Map<String, Value>>,
    session: Option<String>,
    upload: Option<String>,
    light: Option<LightUpload>,
    #[serde(default)]
    results: Vec<UsedResult>,
    #[serde(default)]
    named: Vec<UsedResult>,
    #[serde(flatten)]
    rest: Map<String, Value>,
}

impl TryFrom<Stored> for Spec {
    type Error = String;

    fn try_from(stored: Stored) -> Result<Self, String> {
        let Stored { id, name, operation, options, session, upload, light, results, named, rest } = stored;
        let options = match options {
            Some(options) => options,
            None if operation.is("polarization") => polarization_options(rest)?,
            None => Map::new(),
        };
        Ok(Self { id, name, operation, options, session, upload, light, results, named })
    }
}

/// Options of polarization that stood beside the operation.
const KEYS: [&str; 10] = [
    "model",
    "align",
    "oblique",
    "demosaic",
    "offset_deg",
    "smooth",
    "smooth_maps",
    "smoothed_exr",
    "palette",
    "no_scale_bar",
];

/// Options of polarization from the keys beside the operation; null and an empty model mean the defaults.
///
/// # Errors
/// A sentence for an invalid `period`.
pub fn polarization_options(keys: Map<String, Value>) -> Result<Map<String, Value>, String> {
    let mut options = Map::new();
    for (key, value) in keys {
        let given = !value.is_null() && value != "";
        if key == "period" && given {
            let method = PeriodMethod::deserialize(value).map_err(|e| format!("period: {e}"))?;
            // Serialization of plain data cannot fail.
            let with = serde_json::to_value(Options::default().with_period(&method)).unwrap_or_default();
            let of_period = |key: &str| !KEYS.contains(&key);
            options.extend(with.as_object().cloned().unwrap_or_default().into_iter().filter(|(key, _)| of_period(key)));
        } else if given && KEYS.contains(&key.as_str()) {
            options.insert(key, value);
        }
    }
    Ok(options)
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::{from_value, json, to_value};

    fn read(stored: &Value) -> Spec {
        from_value(stored.clone()).unwrap()
    }

    /// Formats of stored jobs: options of polarization only, the operation as `method`, and the current one.
    #[test]
    fn jobs_of_every_version_are_read() {
        let first = json!({ "id": "1", "session": "s", "upload": null, "model": "", "offset_deg": 1.5 });
        let spec = read(&first);
        assert_eq!(
            (spec.operation.name(), to_value(&spec.options).unwrap()),
            ("polarization", json!({ "offset_deg": 1.5 }))
        );

        let period = json!({ "from": "contrast", "range_um": [1.2, 3.0], "depth_um": 0.1 });
        let second = json!({ "id": "2", "method": "polarization", "options": null, "session": null, "upload": "u", "model": "auto",
            "oblique": "off", "align": "auto", "demosaic": "none", "offset_deg": 0.0, "smooth": "light", "smooth_maps": true,
            "smoothed_exr": false, "period": period, "palette": "hsv", "no_scale_bar": false });
        let options: Options = from_value(Value::Object(read(&second).options)).unwrap();
        assert_eq!(
            (options.contrast_period, options.depth_um, options.index_above),
            (Some([1.2, 3.0]), Some(0.1), Some(1.0))
        );
        assert!(options.smooth_maps && options.palette == nacre_image::Palette::Hsv && options.model.is_some());

        let third = json!({ "id": "3", "method": "hdr", "options": { "align": "off" }, "session": "s", "upload": null, "model": "",
            "offset_deg": 0.0 });
        let spec = read(&third);
        assert_eq!(to_value(&spec.options).unwrap(), json!({ "align": "off" }));
        let now =
            json!({ "id": "3", "operation": "hdr", "options": { "align": "off" }, "session": "s", "upload": null });
        assert_eq!(to_value(&spec).unwrap(), now);
        assert_eq!(read(&now), spec);
    }
}
