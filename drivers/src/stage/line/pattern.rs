//! Templates of sent lines and patterns of answers for a configured stage: literal text with at most one placeholder.
//! `{{` and `}}` stand for braces.

/// Maximum length of a template or pattern.
const MAX_TEXT: usize = 200;

/// Maximum number of decimals of a sent number.
const MAX_DECIMALS: usize = 9;

/// Meaning of a placeholder.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Hole {
    /// `{angle}`: degrees.
    Angle,
    /// `{units}`: the stage's own units.
    Units,
    /// `{number}`: an ignored number.
    Number,
    /// `{any}`: ignored text.
    Any,
}

/// Literal text around a placeholder.
#[derive(Clone, Debug, PartialEq, Eq)]
struct Parts {
    before: String,
    hole: Option<(Hole, usize)>,
    after: String,
}

/// Text to send, with a placeholder for the target of a move.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Template(Parts);

/// Pattern of an answer.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Pattern(Parts);

impl Template {
    /// Parses a template.
    ///
    /// # Errors
    /// The defect of the template.
    pub fn new(text: &str) -> Result<Self, String> {
        let parts = parts(text)?;
        match parts.hole {
            Some((Hole::Number | Hole::Any, _)) => Err("only {angle} and {units} can be sent".into()),
            _ => Ok(Self(parts)),
        }
    }

    /// Whether it contains the target of a move.
    pub fn has_target(&self) -> bool {
        self.0.hole.is_some()
    }

    /// The text for a target.
    pub fn fill(&self, angle_deg: f64, units_per_deg: f64) -> String {
        let Parts { before, hole, after } = &self.0;
        match hole {
            Some((Hole::Units, decimals)) => format!("{before}{:.decimals$}{after}", angle_deg * units_per_deg),
            Some((_, decimals)) => format!("{before}{angle_deg:.decimals$}{after}"),
            None => before.clone(),
        }
    }
}

/// An answer that matches a pattern.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Match {
    /// Without an angle.
    Plain,
    /// With an angle in degrees.
    Degrees(f64),
}

impl Pattern {
    /// Parses a pattern.
    ///
    /// # Errors
    /// The defect of the pattern.
    pub fn new(text: &str) -> Result<Self, String> {
        let parts = parts(text)?;
        if parts.hole.is_none() && parts.before.is_empty() {
            return Err("it is empty".into());
        }
        Ok(Self(parts))
    }

    /// Whether it contains an angle.
    pub fn has_angle(&self) -> bool {
        matches!(self.0.hole, Some((Hole::Angle | Hole::Units, _)))
    }

    /// Compares with a whole line; `None` if it does not match.
    pub fn matches(&self, line: &[u8], units_per_deg: f64) -> Option<Match> {
        let line = std::str::from_utf8(line).ok()?.trim();
        let Parts { before, hole, after } = &self.0;
        let Some((hole, _)) = hole else { return (line == before.trim()).then_some(Match::Plain) };
        let inside = line.strip_prefix(before.trim_start())?.strip_suffix(after.trim_end())?;
        match hole {
            Hole::Any => Some(Match::Plain),
            Hole::Number => decimal(inside).map(|_| Match::Plain),
            Hole::Angle => decimal(inside).map(Match::Degrees),
            Hole::Units => decimal(inside).map(|units| Match::Degrees(units / units_per_deg)),
        }
    }
}

/// A signed decimal number with an optional exponent.
fn decimal(text: &str) -> Option<f64> {
    let text = text.trim();
    let plain = text.len() <= 30 && text.bytes().all(|b| b.is_ascii_digit() || b"+-.eE".contains(&b));
    text.parse().ok().filter(|value: &f64| plain && value.is_finite())
}

fn parts(text: &str) -> Result<Parts, String> {
    if text.len() > MAX_TEXT {
        return Err(format!("it is longer than {MAX_TEXT} bytes"));
    }
    let mut parts = Parts { before: String::new(), hole: None, after: String::new() };
    let mut rest = text;
    while let Some(letter) = rest.chars().next() {
        let literal = if parts.hole.is_some() { &mut parts.after } else { &mut parts.before };
        if rest.starts_with("{{") || rest.starts_with("}}") {
            literal.push(letter);
            rest = &rest[2..];
        } else if letter == '}' {
            return Err("a } without {; write }} for a brace".into());
        } else if letter == '{' {
            let (name, after) = rest[1..].split_once('}').ok_or("a { without }; write {{ for a brace")?;
            if parts.hole.is_some() {
                return Err("more than one placeholder".into());
            }
            parts.hole = Some(hole(name)?);
            rest = after;
        } else {
            literal.push(letter);
            rest = &rest[letter.len_utf8()..];
        }
    }
    Ok(parts)
}

/// A placeholder and its decimals.
fn hole(name: &str) -> Result<(Hole, usize), String> {
    let (name, decimals) = match name.split_once(":.") {
        Some((name, digits)) => (name, digits.parse().ok().filter(|d| *d <= MAX_DECIMALS)),
        None => (name, Some(3)),
    };
    let decimals = decimals.ok_or_else(|| format!("decimals that are none; give 0 to {MAX_DECIMALS}"))?;
    let hole = match name {
        "angle" => Hole::Angle,
        "units" => Hole::Units,
        "number" => Hole::Number,
        "any" => Hole::Any,
        _ => return Err(format!("{{{name}}} is not known; there are {{angle}}, {{units}}, {{number}} and {{any}}")),
    };
    Ok((hole, decimals))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn templates_are_filled() {
        let filled = |text| Template::new(text).unwrap().fill(12.34567, 100.0);
        assert_eq!(filled("MOVE {angle:.3}"), "MOVE 12.346");
        assert_eq!(filled("{{{units:.0}}}"), "{1235}");
        assert_eq!(filled("HOME"), "HOME");
    }

    #[test]
    fn patterns_match_whole_lines() {
        let matched = |text, line: &str| Pattern::new(text).unwrap().matches(line.as_bytes(), 10.0);
        assert_eq!(matched("POS {angle}", "POS -12.5 "), Some(Match::Degrees(-12.5)));
        assert_eq!(matched("POS {units} steps", "POS 50 steps"), Some(Match::Degrees(5.0)));
        assert_eq!(matched("OK", "OK"), Some(Match::Plain));
        assert_eq!(matched("ERR{any}", "ERR 5: stuck"), Some(Match::Plain));
        for (text, line) in [("OK", "OKAY"), ("POS {angle}", "POS"), ("POS {angle}", "POS inf"), ("{number}", "x")] {
            assert_eq!(matched(text, line), None, "{text} {line}");
        }
    }

    #[test]
    fn defects_are_named() {
        for text in ["{", "}", "{angel}", "{angle}{angle}", "{angle:.x}", "{angle:.99}", "{number}", "{any}"] {
            assert!(Template::new(text).is_err(), "{text}");
        }
        assert!(Pattern::new("").is_err());
        assert!(Pattern::new(&"x".repeat(300)).is_err());
    }

    proptest! {
        #[test]
        fn angles_come_back(
            before in "[A-Z{}]{0,8}", after in "[A-Z{}]{0,8}", angle in -1e4..1e4_f64, per_deg in 0.01..1e4_f64,
        ) {
            let literal = |text: &str| text.replace('{', "{{").replace('}', "}}");
            for hole in ["{angle:.6}", "{units:.9}"] {
                let text = format!("{}{hole}{}", literal(&before), literal(&after));
                let line = Template::new(&text).unwrap().fill(angle, per_deg);
                let Some(Match::Degrees(back)) = Pattern::new(&text).unwrap().matches(line.as_bytes(), per_deg) else {
                    panic!("{text} {line}")
                };
                prop_assert!((back - angle).abs() < 1e-5);
            }
        }

        #[test]
        fn nothing_is_too_strange(text in "[{}a-z:.0-9é]{0,20}", line in prop::collection::vec(any::<u8>(), 0..40)) {
            if let Ok(pattern) = Pattern::new(&text) {
                pattern.matches(&line, 1.0);
            }
        }
    }
}
