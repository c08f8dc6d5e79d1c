//! Properties of an INDI device, as the server defines and updates them.

use super::xml::Element;
use std::collections::BTreeMap;

/// Largest number of properties of a device.
const MAX_PROPERTIES: usize = 2000;
/// Longest message of a device.
const MAX_MESSAGE: usize = 200;

/// State of a property.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum State {
    /// Nothing happened yet.
    #[default]
    Idle,
    /// The last command was executed.
    Ok,
    /// The last command is being executed.
    Busy,
    /// The last command failed.
    Alert,
}

/// Value of an element of a property.
#[derive(Clone, Debug, PartialEq)]
pub enum Value {
    /// A number and its range.
    Number {
        /// Value.
        value: f64,
        /// Smallest and largest value; equal if there are no limits.
        range: [f64; 2],
    },
    /// A switch.
    Switch(bool),
    /// A text.
    Text(String),
}

/// A property.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Property {
    /// State.
    pub state: State,
    /// Elements by name.
    pub values: BTreeMap<String, Value>,
    /// Number of definitions and updates so far.
    pub updates: u64,
}

/// A picture or file of a property.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Blob {
    /// Name of the property.
    pub property: String,
    /// Size after decompression in bytes, as announced.
    pub size: usize,
    /// Format, such as `.fits` or `.fits.z`.
    pub format: String,
    /// Content in base64.
    pub base64: Vec<u8>,
}

/// Properties of one device.
#[derive(Clone, Debug, Default)]
pub struct Properties {
    device: String,
    all: BTreeMap<String, Property>,
    /// The last picture that was not taken.
    pub blob: Option<Blob>,
    /// The device's last message.
    pub message: String,
}

impl State {
    fn of(text: &str) -> Option<Self> {
        match text {
            "Idle" => Some(Self::Idle),
            "Ok" => Some(Self::Ok),
            "Busy" => Some(Self::Busy),
            "Alert" => Some(Self::Alert),
            _ => None,
        }
    }
}

impl Properties {
    /// Properties of a device, none of which is known yet.
    pub fn new(device: &str) -> Self {
        Self { device: device.to_owned(), ..Self::default() }
    }

    /// A property.
    pub fn get(&self, name: &str) -> Option<&Property> {
        self.all.get(name)
    }

    /// Number of updates of a property so far.
    pub fn updates(&self, name: &str) -> u64 {
        self.all.get(name).map_or(0, |property| property.updates)
    }

    /// A number with its range.
    pub fn number(&self, property: &str, element: &str) -> Option<(f64, [f64; 2])> {
        match self.all.get(property)?.values.get(element)? {
            Value::Number { value, range } => Some((*value, *range)),
            _ => None,
        }
    }

    /// A switch.
    pub fn switch(&self, property: &str, element: &str) -> Option<bool> {
        match self.all.get(property)?.values.get(element)? {
            Value::Switch(on) => Some(*on),
            _ => None,
        }
    }

    /// A text.
    pub fn text(&self, property: &str, element: &str) -> Option<&str> {
        match self.all.get(property)?.values.get(element)? {
            Value::Text(text) => Some(text),
            _ => None,
        }
    }

    /// Takes a message of the server. Those of other devices and of unknown kinds are passed over.
    pub fn take(&mut self, mut element: Element) {
        if element.get("device") != self.device {
            return;
        }
        let message: String = element.get("message").chars().filter(|c| !c.is_control()).take(MAX_MESSAGE).collect();
        if !message.is_empty() {
            self.message = message;
        }
        let name = element.get("name").to_owned();
        match element.name.as_str() {
            "defNumberVector" | "defSwitchVector" | "defTextVector" | "defLightVector" | "defBLOBVector" => {
                let full = self.all.len() >= MAX_PROPERTIES && !self.all.contains_key(&name);
                if !full && !name.is_empty() {
                    let updates = self.updates(&name) + 1;
                    let mut property = Property { updates, ..Property::default() };
                    property.update(&element);
                    self.all.insert(name, property);
                }
            }
            "setNumberVector" | "setSwitchVector" | "setTextVector" | "setLightVector" => {
                if let Some(property) = self.all.get_mut(&name) {
                    property.updates += 1;
                    property.update(&element);
                }
            }
            "setBLOBVector" => {
                if let Some(property) = self.all.get_mut(&name) {
                    property.updates += 1;
                }
                if let Some(one) = element.children.pop().filter(|one| one.name == "oneBLOB") {
                    let size = one.get("size").trim().parse().unwrap_or(usize::MAX);
                    let format = one.get("format").to_owned();
                    self.blob = Some(Blob { property: name, size, format, base64: one.text });
                }
            }
            // Without a name, the device is gone.
            "delProperty" if name.is_empty() => self.all.clear(),
            "delProperty" => drop(self.all.remove(&name)),
            _ => {}
        }
    }
}

impl Property {
    fn update(&mut self, element: &Element) {
        self.state = State::of(element.get("state")).unwrap_or(self.state);
        for child in &element.children {
            let (name, text) = (child.get("name"), child.trimmed());
            let value = match child.name.as_str() {
                "defNumber" => {
                    let range = [child.get("min"), child.get("max")].map(|t| number(t).unwrap_or(0.0));
                    number(&text).map(|value| Value::Number { value, range })
                }
                "oneNumber" => number(&text).map(|value| {
                    let known = match self.values.get(name) {
                        Some(Value::Number { range, .. }) => *range,
                        _ => [0.0; 2],
                    };
                    let bound = |key: &str, known: f64| number(child.get(key)).unwrap_or(known);
                    Value::Number { value, range: [bound("min", known[0]), bound("max", known[1])] }
                }),
                "defSwitch" | "oneSwitch" => match text.as_str() {
                    "On" => Some(Value::Switch(true)),
                    "Off" => Some(Value::Switch(false)),
                    _ => None,
                },
                "defText" | "oneText" => Some(Value::Text(text)),
                _ => None,
            };
            // An unreadable value is missing, so that no old one passes for it.
            match value {
                Some(value) => drop(self.values.insert(name.to_owned(), value)),
                None => drop(self.values.remove(name)),
            }
        }
    }
}

/// A number, which may be sexagesimal: `-12:30:36` is -12.51.
pub fn number(text: &str) -> Option<f64> {
    let text = text.trim();
    if let Ok(value) = text.parse::<f64>() {
        return value.is_finite().then_some(value);
    }
    let (sign, digits) = text.strip_prefix('-').map_or((1.0, text), |rest| (-1.0, rest));
    let parts: Vec<&str> = digits.split([':', ' ', ';']).filter(|part| !part.is_empty()).collect();
    if !(2..=3).contains(&parts.len()) || !digits.chars().all(|c| c.is_ascii_digit() || ":; .".contains(c)) {
        return None;
    }
    let mut value = 0.0;
    for (part, unit) in parts.iter().zip([1.0, 60.0, 3600.0]) {
        value += part.parse::<f64>().ok().filter(|v| v.is_finite())? / unit;
    }
    Some(sign * value)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::indi::xml::Reader;
    use proptest::prelude::*;

    fn properties(text: &str) -> Properties {
        let (mut reader, mut properties) = (Reader::default(), Properties::new("R"));
        reader.push(text.as_bytes()).unwrap();
        std::iter::from_fn(|| reader.next_element()).for_each(|element| properties.take(element));
        properties
    }

    const DEFINED: &str = "<defNumberVector device='R' name='ANGLE' state='Idle'><defNumber name='A' min='0' max='360'>\n 5 \n\
        </defNumber></defNumberVector><defSwitchVector device='R' name='S' state='Ok'><defSwitch name='ON'>On</defSwitch>\
        </defSwitchVector><defTextVector device='R' name='T'><defText name='X'>a &amp; b</defText></defTextVector>\
        <defNumberVector device='other' name='ANGLE'/>";

    #[test]
    fn definitions_and_updates_are_kept() {
        let one = "<setNumberVector device='R' name='ANGLE' state='Busy' message='turns'><oneNumber name='A'>7.5</oneNumber>\
            </setNumberVector><setNumberVector device='R' name='NONE'/>";
        let known = properties(&format!("{DEFINED}{one}"));
        assert_eq!(known.number("ANGLE", "A"), Some((7.5, [0.0, 360.0])));
        assert_eq!((known.get("ANGLE").unwrap().state, known.updates("ANGLE")), (State::Busy, 2));
        assert_eq!((known.switch("S", "ON"), known.text("T", "X")), (Some(true), Some("a & b")));
        assert_eq!((known.switch("S", "OFF"), known.number("S", "ON"), known.updates("NONE")), (None, None, 0));
        assert_eq!(known.message, "turns");
        let nonsense = "<setNumberVector device='R' name='ANGLE'><oneNumber name='A'>x</oneNumber></setNumberVector>";
        assert_eq!(properties(&format!("{DEFINED}{nonsense}")).number("ANGLE", "A"), None);
        assert!(properties(&format!("{DEFINED}<delProperty device='R' name='S'/>")).get("S").is_none());
        assert!(properties(&format!("{DEFINED}<delProperty device='R'/>")).get("ANGLE").is_none());
        let blob = "<setBLOBVector device='R' name='CCD1'><oneBLOB name='CCD1' size='3' format='.fits'>YWJj</oneBLOB></setBLOBVector>";
        assert_eq!(properties(blob).blob.unwrap().base64, b"YWJj");
    }

    #[test]
    fn numbers_may_be_sexagesimal() {
        for (text, value) in [(" 1.5 ", 1.5), ("-12:30:36", -12.51), ("-0:30", -0.5), ("1 30", 1.5)] {
            assert!((number(text).unwrap() - value).abs() < 1e-12, "{text}");
        }
        for text in ["", "nan", "inf", "x", "1:", "1:2:3:4", "1e999", "--1:2"] {
            assert_eq!(number(text), None, "{text}");
        }
    }

    proptest! {
        #[test]
        fn any_text_is_a_number_or_none(text in "[-0-9:;. e]{0,12}") {
            if let Some(value) = number(&text) {
                prop_assert!(value.is_finite());
            }
        }
    }
}
