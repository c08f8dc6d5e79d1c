//! Header of a text grid: size, pitch, units and gaps, in the languages of usual programs.

use super::keys::{Key, find};
use super::unit::{quantity, unit_in, unit_um};

/// Named column: its axis, `x`, `y`, `z` or ` `, and its unit in µm.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Column {
    pub axis: char,
    pub unit_um: Option<f64>,
}

/// Statements of the header of a text grid.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Header {
    pub columns: Option<usize>,
    pub rows: Option<usize>,
    pub width_um: Option<f64>,
    pub height_um: Option<f64>,
    /// Common size of both axes, in µm.
    pub size_um: Option<f64>,
    pub pitch_um: [Option<f64>; 2],
    /// Pitch without a unit.
    pub bare: [Option<f64>; 2],
    pub unit_um: Option<f64>,
    /// Unit of the values that is not a length.
    pub other_unit: Option<String>,
    /// µm per unit of the values, if they are not lengths.
    pub factor_um: Option<f64>,
    pub nodata: Option<f64>,
    pub channel: Option<String>,
    /// Whether a number with a decimal comma was found.
    pub decimal_comma: bool,
    /// Number whose comma may separate decimals or thousands.
    pub ambiguous: Option<String>,
    /// Names of the columns in the last line before the numbers.
    pub names: Vec<Column>,
    /// Whether it is the header of an ESRI grid.
    pub esri: bool,
    /// Contradiction, or a statement that cannot be applied.
    pub problem: Option<String>,
}

fn set<T: Copy + PartialEq>(problem: &mut Option<String>, name: &str, place: &mut Option<T>, value: Option<T>) {
    let Some(value) = value else { return };
    if place.is_some_and(|known| known != value) && problem.is_none() {
        *problem = Some(format!("says two different things of its {name}"));
    }
    *place = Some(value);
}

impl Header {
    /// Whether both sizes of an image are stated.
    pub(super) fn is_sized(&self) -> bool {
        self.width_um.is_some() && self.height_um.is_some()
    }

    /// Parses `Name: value unit`, `# Name = value unit`, `name value` or `name;value;unit`; other lines may name the
    /// columns.
    pub(super) fn take(&mut self, line: &str) {
        // `h=650 w=650` holds two pairs.
        if line.matches('=').count() > 1 && !line.contains(':') {
            line.split_whitespace().for_each(|part| self.statement(part));
        } else {
            self.statement(line);
        }
    }

    fn statement(&mut self, line: &str) {
        let line = line.trim_start_matches(['#', '%', '!', '/', ' ']).trim_matches(['\t', ' ', '"']);
        if line.is_empty() {
            return;
        }
        self.names = if line.contains([':', '=']) { vec![] } else { names(line) };
        let cuts = [line.find([':', '=', '\t', ';']), key_end(line), line.find(',')];
        let pairs = cuts.into_iter().flatten().map(|cut| line.split_at(cut));
        let known = pairs.filter_map(|(name, value)| Some((name, find(&bare(name))?, value))).next();
        if let Some((name, key, value)) = known {
            self.pair(name, key, value.trim_start_matches([':', '=', ' ', '\t', ';', ',']).trim());
        }
        self.esri |= ["xll", "yll", "nodata_value"].iter().any(|word| line.to_lowercase().starts_with(word));
    }

    fn pair(&mut self, name: &str, key: Key, value: &str) {
        let bare = bare(name);
        let parsed = quantity(value);
        let number = parsed.map(|(number, _)| number);
        let rest = parsed.map_or("", |(_, rest)| rest);
        let unit = unit_um(rest).or_else(|| unit_in(name).filter(|_| name.contains(['[', '(', '{'])));
        match comma(value).filter(|_| parsed.is_some()) {
            Some(true) => self.decimal_comma = true,
            Some(false) => self.ambiguous = Some(format!("{} is {value:.40}", name.trim())),
            None => {}
        }
        let length = number.zip(unit).map(|(n, u)| n * u).filter(|um| *um > 0.0);
        let count = || number.filter(|n| (1.0..1e6).contains(n) && n.fract() == 0.0).map(|n| n as usize);
        let problem = &mut self.problem;
        match key {
            Key::Columns if length.is_none() => set(problem, "columns", &mut self.columns, count()),
            Key::Rows if length.is_none() => set(problem, "rows", &mut self.rows, count()),
            Key::Columns | Key::Width if length.is_some() && !counts(&bare) => {
                set(problem, "width", &mut self.width_um, length)
            }
            Key::Rows | Key::Height if length.is_some() && !counts(&bare) => {
                set(problem, "height", &mut self.height_um, length)
            }
            // `w=650` counts pixels.
            Key::Width if bare == "w" => set(problem, "columns", &mut self.columns, count()),
            Key::Height if bare == "h" => set(problem, "rows", &mut self.rows, count()),
            Key::Size => self.size(value, length),
            Key::Pitch if length.is_some() => set(problem, "pitch", &mut self.pitch_um[0], length),
            Key::PitchDown if length.is_some() => set(problem, "pitch", &mut self.pitch_um[1], length),
            Key::Bare | Key::Pitch if length.is_none() => set(problem, "pitch", &mut self.bare[0], number),
            Key::BareDown | Key::PitchDown if length.is_none() => set(problem, "pitch", &mut self.bare[1], number),
            Key::Bare => set(problem, "pitch", &mut self.pitch_um[0], length),
            Key::BareDown => set(problem, "pitch", &mut self.pitch_um[1], length),
            Key::PixelUm => set(problem, "pitch", &mut self.pitch_um[0], number),
            Key::ValueUnit | Key::Unit => self.value_unit(value),
            Key::NoData => self.nodata = number,
            Key::Factor => self.factor(name, number, unit),
            Key::Channel => self.channel = Some(value.chars().take(80).collect()),
            _ => {}
        }
    }

    /// Parses `10 µm`, `10 x 8 µm` or `10 µm × 8 µm`.
    fn size(&mut self, value: &str, length: Option<f64>) {
        let parts: Vec<_> = value.split(['x', '×', '*', 'X']).collect();
        if let [first, second] = parts[..]
            && let (Some((a, unit_a)), Some((b, unit_b))) = (quantity(first), quantity(second))
            && let Some(down) = unit_um(unit_b)
        {
            self.width_um = Some(a * unit_um(unit_a).unwrap_or(down));
            self.height_um = Some(b * down);
            return;
        }
        self.size_um = length;
    }

    fn value_unit(&mut self, value: &str) {
        let value = value.trim_matches(['[', ']', '(', ')', '"', ' ', ';', ',']);
        match unit_um(value) {
            Some(unit) => set(&mut self.problem, "unit", &mut self.unit_um, Some(unit)),
            None if value.is_empty() || value == "-" => {}
            None => self.other_unit = Some(value.chars().take(20).collect()),
        }
    }

    fn factor(&mut self, name: &str, number: Option<f64>, unit: Option<f64>) {
        match (number, unit.or_else(|| unit_in(name))) {
            (Some(n), Some(unit)) => self.factor_um = Some(n * unit),
            (Some(1.0) | None, None) => {}
            (Some(n), None) if self.problem.is_none() => {
                self.problem = Some(format!("says that its values are to be multiplied by {n} ({})", name.trim()));
            }
            _ => {}
        }
    }
}

/// Key in lower case without unit and punctuation.
fn bare(name: &str) -> String {
    name.split(['[', '(', '{']).next().unwrap_or_default().trim().trim_matches(['"', '.']).to_lowercase()
}

/// Whether a key can only count pixels: `rows: 5 µm` is no size.
fn counts(name: &str) -> bool {
    !["image width", "image height", "width", "height"].contains(&name)
        && matches!(find(name), Some(Key::Columns | Key::Rows))
}

/// Whether a comma is decimal, as in `6,4`, or may separate thousands, as in `1,200`; `None` without a comma.
fn comma(value: &str) -> Option<bool> {
    let digits = |c: char| c.is_ascii_digit();
    let (whole, after) = value.split_once(',')?;
    let whole = whole.rsplit(|c: char| !digits(c)).next().unwrap_or_default();
    let fraction = after.split(|c: char| !digits(c)).next().unwrap_or_default();
    let thousands = fraction.len() == 3 && (1..=3).contains(&whole.len()) && !whole.starts_with('0');
    (!fraction.is_empty()).then_some(!thousands)
}

/// End of the name in `ncols 64`.
fn key_end(line: &str) -> Option<usize> {
    let number =
        |at: usize| line[at..].trim_start().starts_with(|c: char| c.is_ascii_digit() || matches!(c, '+' | '-' | '.'));
    line.match_indices(' ').map(|(at, _)| at).find(|at| number(*at)).or_else(|| line.rfind(' '))
}

/// Names of columns.
fn names(line: &str) -> Vec<Column> {
    let sign = ['\t', ';', '|', ','].into_iter().find(|sign| line.contains(*sign));
    let cells: Vec<&str> = match sign {
        Some(sign) => line.split(sign).collect(),
        None if line.contains(['[', '(']) => line.split_inclusive([']', ')']).collect(),
        None => line.split_whitespace().collect(),
    };
    let column = |cell: &&str| {
        let name = cell.trim().trim_matches(['"', '#', ' ']).to_lowercase();
        let begins = |words: &[&str]| words.iter().any(|w| name.starts_with(w));
        let single = |c: char| {
            name.strip_prefix(c).is_some_and(|rest| rest.is_empty() || !rest.starts_with(|c: char| c.is_alphabetic()))
        };
        let axis = match () {
            () if single('x') => 'x',
            () if single('y') => 'y',
            () if single('z') || single('h') => 'z',
            () if begins(&[
                "lateral",
                "distance",
                "position",
                "abstand",
                "weg",
                "länge",
                "strecke",
                "distancia",
                "distanza",
            ]) =>
            {
                'x'
            }
            () if begins(&[
                "height", "höhe", "hoehe", "hauteur", "altura", "altezza", "depth", "tiefe", "profil", "raw", "topo",
            ]) =>
            {
                'z'
            }
            () => ' ',
        };
        Column { axis, unit_um: unit_in(cell.trim().trim_matches('"')) }
    };
    cells.iter().take(64).map(column).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Found by fuzzing: endless division of a word with two signs.
    #[test]
    fn two_equals_signs_in_a_word_end() {
        let mut header = Header::default();
        for line in ["a==b", "# =", "==", "h=3 w==5", "Zresolution = 1e-1=m0Range=5e-9"] {
            header.take(line);
        }
        assert_eq!((header.rows, header.columns), (Some(3), Some(5)));
        assert_eq!(header.problem, None);
    }
}
