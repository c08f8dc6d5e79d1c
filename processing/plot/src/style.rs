//! Colours and number format of all charts.

/// Colour of text.
pub const INK: &str = "#1c2430";
/// Colour of secondary text.
pub const SOFT: &str = "#56606e";
/// Colour of grid lines.
pub const GRID: &str = "#e3e7ec";
/// Colour of the frames of axes.
pub const FRAME: &str = "#9aa4b0";
/// Colour of wrong results.
pub const ALARM: &str = "#c1121f";

/// Formats a number to about three digits: `12`, `0.25`, `40,000`, `2.5 · 10⁻¹³`.
///
/// Numbers from 0.001 to 100,000 have no exponent and keep all digits of their integer part.
pub fn number(value: f64) -> String {
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

/// Adds a comma between thousands, from five digits on.
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
