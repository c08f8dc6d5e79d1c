//! Versions of file formats.

use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde::de::Error;
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use std::borrow::Cow;

/// Version of a format; `LATEST` is written. Earlier versions are read, and a missing version counts as the first.
/// Later versions are rejected with their number.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Version<const LATEST: u32>;

impl<const LATEST: u32> Serialize for Version<LATEST> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_u32(LATEST)
    }
}

impl<'de, const LATEST: u32> Deserialize<'de> for Version<LATEST> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let found = u32::deserialize(deserializer)?;
        if found > LATEST {
            let problem =
                format!("version {found} is newer than this program, which reads up to {LATEST}; update nacre");
            return Err(D::Error::custom(problem));
        }
        if found == 0 { Err(D::Error::custom("version 0 does not exist; give 1")) } else { Ok(Self) }
    }
}

impl<const LATEST: u32> JsonSchema for Version<LATEST> {
    fn schema_name() -> Cow<'static, str> {
        format!("Version{LATEST}").into()
    }

    fn inline_schema() -> bool {
        true
    }

    fn json_schema(_: &mut SchemaGenerator) -> Schema {
        json_schema!({ "type": "integer", "minimum": 1, "maximum": LATEST })
    }
}

#[cfg(test)]
mod tests {
    use super::Version;
    use serde_json::{from_str, to_string};

    #[test]
    fn later_versions_are_refused_by_number() {
        assert_eq!(to_string(&Version::<2>).unwrap(), "2");
        assert!(from_str::<Version<2>>("1").is_ok() && from_str::<Version<2>>("2").is_ok());
        let newer = from_str::<Version<2>>("3").unwrap_err().to_string();
        assert!(newer.contains("version 3") && newer.contains("up to 2"), "{newer}");
        assert!(from_str::<Version<2>>("0").is_err() && from_str::<Version<2>>("\"1\"").is_err());
    }
}
