//! Labels of a camera's choices: shutter speeds, apertures, sensitivities, battery levels.
//!
//! Vendors write them in many ways: "1/60", "0.0100s", "f/5.6", "5.6", "ISO 200", "50%".

/// Longest accepted label in bytes.
const MAX_LABEL: usize = 64;

/// Longest accepted exposure in s.
const MAX_EXPOSURE_S: f64 = 3600.0;

/// A choice of the shutter speed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Speed {
    /// Exposure in s.
    Seconds(f64),
    /// The shutter is open for as long as the button is pressed, or between two presses.
    Bulb,
}

/// Shutter speed of a label; `None` for automatic ones and others without a duration.
pub fn speed(label: &str) -> Option<Speed> {
    let label = short(label)?.to_ascii_lowercase();
    if label.contains("bulb") || label == "time" || label == "t" || label == "b" {
        return Some(Speed::Bulb);
    }
    let number = label.trim_end_matches(['s', '"', '\'', '″']).trim_end();
    let seconds = match number.split_once('/') {
        Some((over, under)) => decimal(over)? / decimal(under)?,
        None => decimal(number)?,
    };
    (seconds > 0.0 && seconds <= MAX_EXPOSURE_S).then_some(Speed::Seconds(seconds))
}

/// f-number of a label.
pub fn aperture(label: &str) -> Option<f64> {
    let label = short(label)?.to_ascii_lowercase();
    let number = label.trim_start_matches('f').trim_start_matches(['/', ' ']);
    decimal(number).filter(|f| (0.5..=256.0).contains(f))
}

/// Sensitivity of a label; `None` for automatic ones and for names without a value, such as "Hi 1".
pub fn iso(label: &str) -> Option<f64> {
    let label = short(label)?.to_ascii_lowercase();
    let number = label.trim_start_matches("iso").trim();
    decimal(number).filter(|iso| (1.0..=1e7).contains(iso))
}

/// Charge of the battery in percent, from 0 to 100; `None` if the label does not state it.
pub fn battery(label: &str) -> Option<f64> {
    let label = short(label)?.to_ascii_lowercase();
    match label.as_str() {
        "low" | "empty" | "exhausted" => return Some(0.0),
        _ => {}
    }
    decimal(label.strip_suffix('%')?.trim_end()).filter(|percent| (0.0..=100.0).contains(percent))
}

/// Whether a label means manual exposure.
pub fn is_manual(label: &str) -> bool {
    short(label).is_some_and(|label| matches!(label.to_ascii_lowercase().as_str(), "m" | "manual" | "manual (m)"))
}

/// Whether an image format is raw files alone, JPEG alone, or something else.
pub fn image_format(label: &str) -> Option<bool> {
    let label = short(label)?.to_ascii_lowercase();
    let has = |words: &[&str]| words.iter().any(|word| label.contains(word));
    let raw = has(&["raw", "nef", "cr2", "cr3", "arw", "raf", "orf", "rw2", "dng", "pef"]) && !has(&["sraw", "mraw"]);
    let jpeg = has(&["jpeg", "jpg", "fine", "normal", "basic", "standard"]);
    let both = has(&["+", " and ", "&"]) || (raw && jpeg);
    match (raw, jpeg) {
        _ if both => None,
        (true, _) => Some(true),
        (false, true) => Some(false),
        (false, false) => None,
    }
}

fn short(label: &str) -> Option<&str> {
    let label = label.trim();
    (!label.is_empty() && label.len() <= MAX_LABEL).then_some(label)
}

/// A positive decimal number, with point or comma.
fn decimal(text: &str) -> Option<f64> {
    let text = text.trim().replace(',', ".");
    // `parse` also accepts "inf", "nan" and exponents.
    let plain = !text.is_empty() && text.bytes().all(|b| b.is_ascii_digit() || b == b'.');
    text.parse::<f64>().ok().filter(|v| plain && v.is_finite())
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn labels_of_several_vendors_are_read() {
        for (label, seconds) in [
            ("1/60", 1.0 / 60.0),
            ("0.0100s", 0.01),
            ("1/8000s", 1.0 / 8000.0),
            ("30", 30.0),
            ("0,3", 0.3),
            ("1.3\"", 1.3),
            ("2s", 2.0),
            ("10/16", 0.625),
            ("1/1.6", 0.625),
        ] {
            assert_eq!(speed(label), Some(Speed::Seconds(seconds)), "{label}");
        }
        for label in ["bulb", "Bulb", "Time", "BULB (0)"] {
            assert_eq!(speed(label), Some(Speed::Bulb), "{label}");
        }
        for label in ["", "auto", "1/0", "0/0", "0", "-1", "1e9", "inf", "nan", "99999999", "1/60/2", "x200"] {
            assert_eq!(speed(label), None, "{label}");
        }
        for label in ["5.6", "f/5.6", "F5.6", "f 5,6"] {
            assert_eq!(aperture(label), Some(5.6), "{label}");
        }
        assert_eq!([aperture("implicit auto"), aperture("f/0"), aperture("Unknown value 0000")], [None; 3]);
        assert_eq!([iso("100"), iso("ISO 200"), iso("Auto"), iso("Hi 1")], [Some(100.0), Some(200.0), None, None]);
        assert_eq!(
            [battery("50%"), battery("Low"), battery("Unknown"), battery("900%")],
            [Some(50.0), Some(0.0), None, None]
        );
        assert!(is_manual("M") && is_manual("Manual") && !is_manual("P") && !is_manual("AV"));
        for (label, raw) in [
            ("RAW", Some(true)),
            ("NEF (Raw)", Some(true)),
            ("RAW + Large Fine JPEG", None),
            ("NEF+Basic", None),
            ("Large Fine JPEG", Some(false)),
            ("JPEG Normal", Some(false)),
            ("sRAW", None),
            ("TIFF (RGB)", None),
        ] {
            assert_eq!(image_format(label), raw, "{label}");
        }
    }

    proptest! {
        #[test]
        fn any_label_gives_a_sane_value_or_none(label in "\\PC{0,80}|[0-9./,s\"f%+ ]{0,12}") {
            if let Some(Speed::Seconds(s)) = speed(&label) {
                prop_assert!(s > 0.0 && s <= MAX_EXPOSURE_S);
            }
            prop_assert!(aperture(&label).is_none_or(|f| (0.5..=256.0).contains(&f)));
            prop_assert!(iso(&label).is_none_or(|i| (1.0..=1e7).contains(&i)));
            prop_assert!(battery(&label).is_none_or(|p| (0.0..=100.0).contains(&p)));
            let _ = (is_manual(&label), image_format(&label));
        }
    }
}
