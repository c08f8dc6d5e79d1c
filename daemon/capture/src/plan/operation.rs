//! Operation of a plan or a job, with its options.

use nacre_base::Error;
use nacre_base::fields::EXAMPLE_WORDS;
use nacre_base::operation::{Entry, Operation, Ready, Registered, read};
use nacre_processing::operations::{OPERATIONS, operation};
use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use serde_json::{Map, Value, json};
use std::borrow::Cow;
use std::fmt;

/// An operation and its options: `{ "operation": "lut", "options": { "size": 512 } }`. Omitted options take their
/// defaults.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct PlannedOperation {
    /// Operation.
    pub operation: Method,
    /// Options by key.
    #[serde(skip_serializing_if = "Map::is_empty")]
    pub options: Map<String, Value>,
}

impl PlannedOperation {
    /// Options in the operation's format.
    pub fn values(&self) -> Value {
        let mut options = self.options.clone();
        if self.operation.is("hdr") {
            // The bench does not move between exposures.
            options.entry("align").or_insert(json!("off"));
        }
        Value::Object(options)
    }

    /// Options of the operation `O`; `None` if another one is requested.
    ///
    /// # Errors
    /// `Input`, naming the key.
    pub fn options_of<O: Operation>(&self) -> Option<Result<O, Error>> {
        self.operation.is(O::NAME).then(|| read(&self.values()))
    }

    /// The operation, ready to run.
    ///
    /// # Errors
    /// `Input`, naming the key.
    pub fn ready(&self) -> Result<Box<dyn Ready>, Error> {
        self.operation.operation().with(&self.values())
    }

    /// Rejects options that are invalid for any frames, and options that name files: a plan may come from another
    /// machine, but its results are computed on this one.
    ///
    /// # Errors
    /// `Input`, naming the key.
    pub fn check(&self) -> Result<(), Error> {
        let mut options = self.values();
        for field in &self.operation.operation().fields().list {
            let Some(Value::String(name)) = field.file(&mut options) else { continue };
            if !field.is_built_in(name) {
                let words = field.schema.get(EXAMPLE_WORDS).and_then(Value::as_array);
                let words = words.into_iter().flatten().filter_map(Value::as_str).collect::<Vec<_>>().join(", ");
                let remedy = if words.is_empty() { "leave it out".into() } else { format!("give one of {words}") };
                let problem = format!("names the file {name:?}, which no plan may");
                return Err(Error::input(field.path.join("."), problem, remedy));
            }
        }
        self.ready()?.check_options()
    }
}

impl<'de> Deserialize<'de> for PlannedOperation {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let keys = Map::<String, Value>::deserialize(deserializer)?;
        Self::of(keys).map_err(serde::de::Error::custom)
    }
}

impl PlannedOperation {
    /// From the keys of a plan, including those of version 1: `{ "method": "lut", "lut": { "size": 512 } }`, and
    /// options of polarization beside its name.
    fn of(mut keys: Map<String, Value>) -> Result<Self, String> {
        let first = keys.shift_remove("method");
        let name = first
            .as_ref()
            .or(keys.get("operation"))
            .ok_or("operation is missing; give one of those that plans take")?;
        let operation = Method::deserialize(name).map_err(|e| e.to_string())?;
        let mut options = Map::new();
        if first.is_some() {
            if operation.is("polarization") {
                options = std::mem::take(&mut keys);
            } else {
                // Plans of version 1 were stored with defaults of polarization for any method.
                keys.retain(|key, value| {
                    !(key == "oblique" && value == "off" || key == "palette" && value == "cyclic")
                });
                let own = keys.shift_remove(operation.name()).unwrap_or_default();
                options.extend(own.as_object().cloned().unwrap_or_default());
            }
        } else {
            keys.shift_remove("operation");
            match keys.shift_remove("options") {
                None => {}
                Some(Value::Object(given)) => options = given,
                Some(other) => return Err(format!("options is {other}; give keys and values")),
            }
        }
        match keys.keys().next() {
            None => Ok(Self { operation, options }),
            Some(key) if first.is_some() => {
                Err(format!("reconstruct.{key} does not belong to the method {}; remove it", operation.name()))
            }
            Some(key) => Err(format!("reconstruct.{key} is neither operation nor options; remove it")),
        }
    }
}

impl JsonSchema for PlannedOperation {
    fn schema_name() -> Cow<'static, str> {
        "PlannedOperation".into()
    }

    fn json_schema(generator: &mut SchemaGenerator) -> Schema {
        let planned = OPERATIONS.iter().filter(|o| PLANNED.contains(&o.name()));
        let one = planned.map(|o| {
            json_schema!({
                "type": "object",
                "description": o.title(),
                "properties": { "operation": { "const": o.name() }, "options": o.schema(generator) },
                "required": ["operation"],
                "additionalProperties": false
            })
        });
        let one: Vec<Schema> = one.collect();
        json_schema!({ "description": "Operation on the frames of a session, and its options.", "oneOf": one })
    }
}

/// Operations on frames that a plan can request.
const PLANNED: [&str; 10] =
    ["polarization", "hdr", "lut", "bokeh", "spots", "flash", "camera", "flat", "analyser", "retarder"];

/// An operation of the registry.
#[derive(Clone, Copy)]
pub struct Method(&'static dyn Registered);

impl Method {
    /// The operation with a name.
    pub fn of(name: &str) -> Option<Self> {
        operation(name).map(Self)
    }

    /// Name of the operation.
    pub fn name(self) -> &'static str {
        self.0.name()
    }

    /// True if the operation has this name.
    pub fn is(self, name: &str) -> bool {
        self.name() == name
    }

    /// The registered operation.
    pub fn operation(self) -> &'static dyn Registered {
        self.0
    }
}

/// Names of all operations, for messages.
pub fn names() -> String {
    OPERATIONS.iter().map(|o| o.name()).collect::<Vec<_>>().join(", ")
}

impl Default for Method {
    /// Polarization: the only method of jobs of version 1.
    fn default() -> Self {
        Self(&Entry::<nacre_polarimetry::Options>::NEW)
    }
}

impl PartialEq for Method {
    fn eq(&self, other: &Self) -> bool {
        self.name() == other.name()
    }
}

impl fmt::Debug for Method {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl Serialize for Method {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(self.name())
    }
}

impl<'de> Deserialize<'de> for Method {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let name = Cow::<str>::deserialize(deserializer)?;
        Self::of(&name).ok_or_else(|| serde::de::Error::custom(format!("{name:?} is none of {}", names())))
    }
}

impl JsonSchema for Method {
    fn schema_name() -> Cow<'static, str> {
        "Operation".into()
    }

    fn json_schema(_: &mut SchemaGenerator) -> Schema {
        let all: Vec<_> = OPERATIONS.iter().map(|o| json!({ "const": o.name(), "description": o.title() })).collect();
        json_schema!({ "description": "An operation.", "oneOf": all })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::{from_value, to_value};

    fn read(plan: &Value) -> Result<PlannedOperation, String> {
        from_value(plan.clone()).map_err(|e| e.to_string())
    }

    #[test]
    fn plans_of_every_version_are_read() {
        let first = json!({ "method": "polarization", "model": "auto", "oblique": "off", "palette": "hsv" });
        let now =
            json!({ "operation": "polarization", "options": { "model": "auto", "oblique": "off", "palette": "hsv" } });
        assert_eq!(read(&first), read(&now));
        assert_eq!(to_value(read(&first).unwrap()).unwrap(), now);
        let first = json!({ "method": "lut", "lut": { "size": 4 }, "oblique": "off", "palette": "cyclic" });
        let now = json!({ "operation": "lut", "options": { "size": 4 } });
        assert_eq!(read(&first), read(&now));
        assert_eq!(to_value(read(&first).unwrap()).unwrap(), now);
        assert_eq!(to_value(read(&json!({ "method": "hdr" })).unwrap()).unwrap(), json!({ "operation": "hdr" }));
    }

    #[test]
    fn wrong_keys_are_named() {
        for (plan, key) in [
            (json!({ "method": "lut", "flash": {} }), "reconstruct.flash"),
            (json!({ "method": "hdr", "palette": "hsv" }), "reconstruct.palette"),
            (json!({ "operation": "lut", "lut": {} }), "reconstruct.lut"),
            (json!({ "operation": "lut", "options": 3 }), "options"),
            (json!({ "options": {} }), "operation"),
            (json!({ "operation": "cook" }), "cook"),
        ] {
            let problem = read(&plan).unwrap_err();
            assert!(problem.contains(key), "{problem}");
        }
        let check = |plan: &Value| read(plan).unwrap().check().unwrap_err().to_string();
        assert!(check(&json!({ "operation": "lut", "options": { "size": 0 } })).contains("size"));
        assert!(check(&json!({ "operation": "polarization", "options": { "modell": "auto" } })).contains("modell"));
    }

    #[test]
    fn an_old_key_is_no_option() {
        assert!(read(&json!({ "method": "polarization", "lut": {} })).unwrap().check().is_err());
    }
}
