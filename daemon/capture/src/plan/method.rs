//! The operation that a plan or a job asks for.

use nacre_base::operation::{Entry, Registered};
use nacre_processing::operations::{OPERATIONS, operation};
use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use serde_json::json;
use std::borrow::Cow;
use std::fmt;

/// An operation of the registry.
#[derive(Clone, Copy)]
pub struct Method(&'static dyn Registered);

impl Method {
    /// The operation of a name.
    pub fn of(name: &str) -> Option<Self> {
        operation(name).map(Self)
    }

    /// Its name.
    pub fn name(self) -> &'static str {
        self.0.name()
    }

    /// Whether it is the operation of this name.
    pub fn is(self, name: &str) -> bool {
        self.name() == name
    }

    /// The operation.
    pub fn operation(self) -> &'static dyn Registered {
        self.0
    }
}

/// Names of all operations, for messages.
pub fn names() -> String {
    OPERATIONS.iter().map(|o| o.name()).collect::<Vec<_>>().join(", ")
}

impl Default for Method {
    /// Polarization: jobs of the first version know no other.
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
