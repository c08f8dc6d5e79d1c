//! Headers of lines `key = value`.

use super::fault::{Fault, Outcome};

/// Pairs of a header, with keys in lower case.
#[derive(Clone, Debug, Default)]
pub(super) struct Keys(Vec<(String, String)>);

impl Keys {
    pub(super) fn add(&mut self, key: &str, value: &str) {
        self.0.push((key.trim().to_lowercase(), value.trim().to_owned()));
    }

    /// Adds a line `key = value`; other lines are ignored.
    pub(super) fn line(&mut self, line: &str, sign: char) {
        if let Some((key, value)) = line.split_once(sign) {
            self.add(key, value);
        }
    }

    pub(super) fn get(&self, key: &str) -> Option<&str> {
        self.0.iter().find(|(known, _)| known == key).map(|(_, value)| value.as_str())
    }

    pub(super) fn ending(&self, end: &str) -> Option<&str> {
        self.0.iter().find(|(known, _)| known.ends_with(end)).map(|(_, value)| value.as_str())
    }

    pub(super) fn need(&self, key: &str) -> Outcome<&str> {
        self.get(key).ok_or_else(|| Fault::damaged(format!("its header has no {key}")))
    }

    pub(super) fn number(&self, key: &str) -> Outcome<f64> {
        let value = self.need(key)?;
        let number = value.parse::<f64>().or_else(|_| value.replace(',', ".").parse());
        number.map_err(|_| Fault::damaged(format!("{key} is {value:.40}, no number")))
    }

    pub(super) fn integer(&self, key: &str) -> Outcome<i64> {
        let number = self.number(key)?;
        let whole = number.fract() == 0.0 && number.abs() < 9e15;
        if whole { Ok(number as i64) } else { Err(Fault::damaged(format!("{key} is {number}, no integer"))) }
    }
}
