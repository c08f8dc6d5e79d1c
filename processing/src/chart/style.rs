//! Colours and sizes that all pictures share.

use super::Summary;

/// Okabe and Ito's colours without the yellow, which is lost on white; told apart with every common colour blindness.
const METHODS: [&str; 7] = ["#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9", "#e69f00", "#333333"];

/// For settings of one method: darker is more, so that the order shows without colour.
const RAMP: [&str; 6] = ["#e8a33a", "#dd6f4d", "#bd4576", "#8a2f8f", "#54278f", "#1f1a5c"];

pub(super) const INK: &str = "#1c2430";
pub(super) const SOFT: &str = "#56606e";
pub(super) const GRID: &str = "#e3e7ec";
pub(super) const FRAME: &str = "#9aa4b0";
pub(super) const ALARM: &str = "#c1121f";

/// Share of confidently wrong pixels from which a point is ringed.
pub(super) const WRONG: f64 = 0.01;

/// Methods of a study, in the order of their first setting.
pub(super) fn methods(summary: &Summary) -> Vec<&str> {
    let mut names: Vec<&str> = vec![];
    for setting in &summary.settings {
        if !names.contains(&setting.method.as_str()) {
            names.push(&setting.method);
        }
    }
    names
}

/// Colour of a setting: its method's, or its place on the ramp where there is but one method.
pub(super) fn color(summary: &Summary, setting: usize) -> &'static str {
    let methods = methods(summary);
    if methods.len() > 1 || summary.settings.len() == 1 {
        let at = methods.iter().position(|m| *m == summary.settings[setting].method).unwrap_or(0);
        return METHODS[at % METHODS.len()];
    }
    let last = (summary.settings.len() - 1).max(1);
    RAMP[(setting * (RAMP.len() - 1) + last / 2) / last]
}

/// Shape of a setting's marks, which tells methods apart in black and white.
pub(super) fn shape(summary: &Summary, setting: usize) -> usize {
    methods(summary).iter().position(|m| *m == summary.settings[setting].method).unwrap_or(0)
}

/// A number as a reader wants it: three digits, no exponent where none is needed.
pub(super) fn number(value: f64) -> String {
    let size = value.abs();
    if value == 0.0 {
        "0".into()
    } else if (1e-3..1e5).contains(&size) {
        let digits = (2 - size.log10().floor() as i32).clamp(0, 6) as usize;
        let text = format!("{value:.digits$}");
        let text = if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.') } else { &text };
        grouped(text).replace('-', "−")
    } else {
        let exponent = size.log10().floor();
        let mantissa = value / 10f64.powf(exponent);
        let power = format!("10{}", superscript(exponent as i32));
        if (mantissa - 1.0).abs() < 0.005 { power } else { format!("{} · {power}", number(mantissa)) }
    }
}

/// With a comma between thousands, from five digits on.
fn grouped(text: &str) -> String {
    let whole = text.split('.').next().unwrap_or(text).trim_start_matches('-').len();
    if whole < 5 || text.contains('.') {
        return text.into();
    }
    let (front, back) = text.split_at(text.len() - 3);
    format!("{front},{back}")
}

fn superscript(n: i32) -> String {
    let digit = |c: char| match c {
        '-' => '⁻',
        '1' => '¹',
        '2' => '²',
        '3' => '³',
        c => c.to_digit(10).and_then(|d| char::from_u32(0x2070 + d)).unwrap_or(c),
    };
    n.to_string().chars().map(digit).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_read_well() {
        for (value, wanted) in [
            (0.0, "0"),
            (12.0, "12"),
            (0.25, "0.25"),
            (1234.6, "1235"),
            (0.001, "0.001"),
            (40_000.0, "40,000"),
            (1e-5, "10⁻⁵"),
            (2.5e-13, "2.5 · 10⁻¹³"),
            (1e6, "10⁶"),
            (-30.0, "−30"),
            (99.996, "100"),
        ] {
            assert_eq!(number(value), wanted);
        }
    }
}
