//! Units of length in usual spellings.

/// µm per unit of length, in one of its spellings.
pub(in crate::height) fn unit_um(name: &str) -> Option<f64> {
    let name = name.trim().trim_matches(['[', ']', '(', ')', '{', '}', '"', '\'', ',', ';', '.']).trim();
    let (name, per) = name.split_once('/').unwrap_or((name, ""));
    // Pixels, points and samples count as 1; `nm/V` is no length.
    if !(per.is_empty() || per.trim_start().to_lowercase().starts_with(['p', 's']) && per.trim() != "s") {
        return None;
    }
    let name = name.split(' ').next().unwrap_or_default().trim();
    let exact = match name {
        "m" => 1e6,
        "dm" => 1e5,
        "cm" => 1e4,
        "mm" => 1e3,
        // Micro sign, Greek letter, and the micro sign in other encodings.
        "µm"
        | "μm"
        | "um"
        | "~m"
        | "\u{fffd}m"
        | "\\u00b5m"
        | "Âµm"
        | "Î¼m"
        | "&micro;m"
        | "\\um"
        | "æm"
        | "ƒÊm"
        | "u"
        | "µ"
        | "μ"
        | "мкм"
        | "㎛"
        | "微米"
        | "マイクロメートル" => 1.0,
        "nm" | "нм" | "㎚" | "纳米" | "ナノメートル" => 1e-3,
        "мм" => 1e3,
        "м" => 1e6,
        // `A` may be the ampere.
        "Å" | "\u{212b}" | "ang" => 1e-4,
        "pm" => 1e-6,
        _ => 0.0,
    };
    if exact > 0.0 {
        return Some(exact);
    }
    // "micrometres", "Mikrometer", "micras", "nanomètres", "micrometri".
    let lower = name.to_lowercase();
    let begins = |words: &[&str]| words.iter().any(|w| lower.starts_with(w));
    Some(match lower.as_str() {
        _ if begins(&["micromet", "micromèt", "micrómet", "micrômet", "mikromet", "mikrometr", "микромет"]) => {
            1.0
        }
        "micron" | "microns" | "mikron" | "micra" | "micras" | "micrones" | "micrón" => 1.0,
        _ if begins(&["nanomet", "nanomèt", "nanómet", "nanômet", "наномет"]) => 1e-3,
        _ if begins(&["millimet", "millimèt", "milímet", "milimet"]) => 1e3,
        _ if begins(&["picomet", "picomèt", "pikomet", "picómet"]) => 1e-6,
        _ if begins(&["ångström", "angstrom", "ångstrom", "angström"]) => 1e-4,
        "meter" | "metre" | "meters" | "metres" | "mètre" | "mètres" | "metro" | "metros" | "metri" => 1e6,
        "nm" | "mm" | "µm" | "μm" | "um" => return unit_um_lower(&lower),
        _ => return None,
    })
}

/// Units in capitals, as in some headers: `NM`, `UM`.
fn unit_um_lower(name: &str) -> Option<f64> {
    Some(match name {
        "nm" => 1e-3,
        "mm" => 1e3,
        _ => 1.0,
    })
}

/// Unit of length in the name of a column or key: `X [nm]`, `x (µm)`, `x in µm`, `X_(microns)`, `z/nm`, `height nm`.
pub(in crate::height) fn unit_in(name: &str) -> Option<f64> {
    let bracketed = name
        .split(['[', '(', '{'])
        .nth(1)
        .and_then(|rest| rest.split([']', ')', '}']).next())
        .map(|unit| unit.trim_start_matches("->").trim());
    if let Some(unit) = bracketed {
        return unit_um(unit);
    }
    let mut words = name.split([' ', '_', '/', ':']).filter(|w| !w.is_empty());
    let first = words.next()?;
    // A single word is a name rather than a unit, unless it cannot be a name.
    match words.next_back() {
        Some(last) => unit_um(last),
        None => unit_um(first).filter(|_| !matches!(first, "m" | "u" | "A" | "a")),
    }
}

/// Number with an optional unit, `6,4 µm` or `6.4e-6m`, and its decimal sign.
pub(in crate::height) fn quantity(text: &str) -> Option<(f64, &str)> {
    let text = text.trim().trim_matches(['"', '\'']);
    let mut end = 0;
    for (at, c) in text.char_indices() {
        let exponent = matches!(c, 'e' | 'E')
            && text[at + 1..].trim_start_matches(['+', '-']).starts_with(|d: char| d.is_ascii_digit())
            && end > 0;
        let sign = matches!(c, '+' | '-') && (at == 0 || text[..at].ends_with(['e', 'E']));
        if !(c.is_ascii_digit() || matches!(c, '.' | ',') || exponent || sign) {
            break;
        }
        end = at + c.len_utf8();
    }
    let number = text[..end].trim_end_matches([',', '.']);
    let decimal = if number.contains(',') { ',' } else { '.' };
    Some((super::number::number(number, decimal)?, text[end..].trim_start_matches([',', ';', '\t', ' ', '\u{a0}'])))
}
