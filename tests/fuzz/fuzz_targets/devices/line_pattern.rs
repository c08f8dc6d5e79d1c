//! Templates and patterns of the configuration, and lines matched against them: pattern and line, separated by a zero
//! byte.

#![no_main]

use libfuzzer_sys::fuzz_target;
use nacre_drivers::stage::line::pattern::{Match, Pattern, Template};

fuzz_target!(|bytes: &[u8]| {
    let cut = bytes.iter().position(|b| *b == 0).unwrap_or(bytes.len());
    let (text, line) = bytes.split_at(cut);
    let line = line.get(1..).unwrap_or_default();
    let Ok(text) = std::str::from_utf8(text) else { return };
    if let Ok(pattern) = Pattern::new(text)
        && let Some(Match::Degrees(angle)) = pattern.matches(line, 100.0)
    {
        assert!(pattern.has_angle() && angle.is_finite());
    }
    if let Ok(template) = Template::new(text) {
        assert!(template.fill(-123.456, 100.0).len() <= text.len() + 30);
    }
});
