//! The header of a text grid: size, pitch, units and gaps, in the languages that programs write.

use super::unit::{quantity, unit_in, unit_um};

/// Meaning of a key.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Key {
    Columns,
    Rows,
    Width,
    Height,
    Size,
    Pitch,
    PitchDown,
    Bare,
    BareDown,
    PixelUm,
    ValueUnit,
    Unit,
    NoData,
    Factor,
    Channel,
}

/// Keys in lower case, brackets and punctuation aside.
const KEYS: &[(Key, &[&str])] = &[
    (
        Key::Columns,
        &[
            "image width",
            "ncols",
            "ncol",
            "columns",
            "cols",
            "xpixels",
            "x pixels",
            "pixels x",
            "xres",
            "x resolution",
            "nx",
            "spalten",
            "anzahl spalten",
            "colonnes",
            "nombre de colonnes",
            "columnas",
            "número de columnas",
            "colonne",
            "numero di colonne",
            "number of columns",
            "points per line",
            "samps/line",
            "x points",
            "kolommen",
            "colunas",
            "столбцы",
            "列数",
        ],
    ),
    (
        Key::Rows,
        &[
            "image height",
            "nrows",
            "nrow",
            "rows",
            "lines",
            "ypixels",
            "y pixels",
            "pixels y",
            "yres",
            "y resolution",
            "ny",
            "zeilen",
            "anzahl zeilen",
            "lignes",
            "nombre de lignes",
            "filas",
            "número de filas",
            "righe",
            "numero di righe",
            "number of rows",
            "number of lines",
            "y points",
            "rijen",
            "linhas",
            "строки",
            "行数",
        ],
    ),
    (
        Key::Width,
        &[
            "real width",
            "width",
            "breite",
            "largeur",
            "ancho",
            "anchura",
            "larghezza",
            "largura",
            "breedte",
            "šířka",
            "sirka",
            "szerokość",
            "szerokosc",
            "ширина",
            "幅",
            "宽度",
            "寬度",
            "너비",
            "bredd",
            "bredde",
            "leveys",
            "genişlik",
            "szélesség",
            "x size",
            "size x",
            "xsize",
            "x range",
            "x length",
            "xlength",
            "x scan size",
            "scan size x",
            "scan width",
            "x scan range",
            "x-größe",
            "field width",
            "w",
        ],
    ),
    (
        Key::Height,
        &[
            "real height",
            "height",
            "höhe",
            "hoehe",
            "hauteur",
            "alto",
            "altura",
            "altezza",
            "hoogte",
            "výška",
            "vyska",
            "wysokość",
            "wysokosc",
            "высота",
            "高さ",
            "高度",
            "높이",
            "höjd",
            "høyde",
            "højde",
            "korkeus",
            "yükseklik",
            "magasság",
            "y size",
            "size y",
            "ysize",
            "y range",
            "y length",
            "ylength",
            "y scan size",
            "scan size y",
            "scan height",
            "y scan range",
            "y-größe",
            "field height",
            "h",
        ],
    ),
    (
        Key::Size,
        &[
            "scan size",
            "scan range",
            "image size",
            "scan length",
            "scangröße",
            "scanbereich",
            "bildgröße",
            "taille",
            "taille du scan",
            "taille de l'image",
            "tamaño",
            "tamaño de barrido",
            "dimensioni",
            "dimensione scansione",
            "size",
            "physical size",
        ],
    ),
    (
        Key::Pitch,
        &[
            "pixel size",
            "pixelsize",
            "pixel width",
            "pixel pitch",
            "pitch",
            "pixelgröße",
            "pixelbreite",
            "pixelabstand",
            "rasterweite",
            "schrittweite",
            "punktabstand",
            "abtastabstand",
            "taille de pixel",
            "taille du pixel",
            "taille des pixels",
            "pas",
            "pas d'échantillonnage",
            "tamaño de píxel",
            "tamaño del píxel",
            "tamaño de pixel",
            "paso",
            "dimensione pixel",
            "dimensione del pixel",
            "passo",
            "tamanho do pixel",
            "pixelgrootte",
            "размер пикселя",
            "sampling",
            "sampling interval",
            "sampling distance",
            "spacing",
            "x spacing",
            "spacing x",
            "step",
            "step size",
            "x step",
            "grid spacing",
            "point spacing",
            "lateral resolution",
            "x increment",
            "x pitch",
            "xscale",
            "x pixel size",
            "ピクセルサイズ",
            "像素尺寸",
        ],
    ),
    (
        Key::PitchDown,
        &[
            "pixel height",
            "pixelhöhe",
            "y spacing",
            "spacing y",
            "y step",
            "y increment",
            "y pitch",
            "yscale",
            "y pixel size",
        ],
    ),
    (Key::Bare, &["cellsize", "cell size", "dx"]),
    (Key::BareDown, &["dy"]),
    (Key::PixelUm, &["pixel_um"]),
    (
        Key::ValueUnit,
        &[
            "z unit",
            "z units",
            "zunit",
            "z-unit",
            "value units",
            "value unit",
            "height unit",
            "height units",
            "data unit",
            "data units",
            "werteeinheit",
            "werteinheit",
            "einheit der werte",
            "z-einheit",
            "z einheit",
            "höheneinheit",
            "unité des valeurs",
            "unités des valeurs",
            "unité de valeur",
            "unités de valeur",
            "unité z",
            "unidad de valor",
            "unidades de valor",
            "unidad de los valores",
            "unidades de los valores",
            "unidades del valor",
            "unidad z",
            "unità dei valori",
            "unità di valore",
            "unità valori",
            "unità z",
            "unidade do valor",
            "unidades do valor",
            "unidades de valores",
            "eenheid waarde",
            "waarde-eenheid",
            "jednotky hodnot",
            "jednotka hodnot",
            "jednostka wartości",
            "единицы значений",
            "единица значений",
            "値の単位",
            "数值单位",
        ],
    ),
    (
        Key::Unit,
        &[
            "unit",
            "units",
            "einheit",
            "einheiten",
            "unité",
            "unités",
            "unidad",
            "unidades",
            "unità",
            "eenheid",
            "unidade",
            "单位",
            "単位",
        ],
    ),
    (
        Key::NoData,
        &[
            "nodata_value",
            "nodata value",
            "nodata",
            "no data",
            "no data value",
            "no_data",
            "missing value",
            "missing_value",
            "missing",
            "fill value",
            "_fillvalue",
            "fillvalue",
            "bad value",
            "invalid value",
            "dummy",
            "fehlwert",
            "ungültiger wert",
            "blank value",
            "valeur manquante",
            "valor nulo",
        ],
    ),
    (
        Key::Factor,
        &[
            "height conversion factor",
            "scale factor",
            "scaling factor",
            "z scale factor",
            "z factor",
            "zfactor",
            "zscale",
            "z scale",
            "multiplier",
            "z multiplier",
            "skalierungsfaktor",
            "facteur d'échelle",
            "factor de escala",
        ],
    ),
    (Key::Channel, &["channel", "kanal", "canal", "canale", "kanaal", "チャンネル", "канал"]),
];

/// A named column: its axis, `x`, `y`, `z` or ` `, and its unit in µm.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Column {
    pub axis: char,
    pub unit_um: Option<f64>,
}

/// What the header of a text grid says.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Header {
    pub columns: Option<usize>,
    pub rows: Option<usize>,
    pub width_um: Option<f64>,
    pub height_um: Option<f64>,
    /// One size for both axes, in µm.
    pub size_um: Option<f64>,
    pub pitch_um: [Option<f64>; 2],
    /// Pitch without a unit.
    pub bare: [Option<f64>; 2],
    pub unit_um: Option<f64>,
    /// A unit of the values that is no length.
    pub other_unit: Option<String>,
    /// µm of one unit of the values, where they are no lengths.
    pub factor_um: Option<f64>,
    pub nodata: Option<f64>,
    pub channel: Option<String>,
    /// Whether a number with a decimal comma was found.
    pub decimal_comma: bool,
    /// Names of the columns in the last line before the numbers.
    pub names: Vec<Column>,
    /// Whether it is the header of an ESRI grid.
    pub esri: bool,
    /// What contradicts itself or cannot be applied.
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
    /// Takes in `Name: value unit`, `# Name = value unit`, `name value`, `name;value;unit`; other lines may name the columns.
    pub(super) fn take(&mut self, line: &str) {
        let line = line.trim_start_matches(['#', '%', '!', '/', ' ']).trim_matches(['\t', ' ', '"']);
        // `h=650 w=650` holds two of them.
        if line.matches('=').count() > 1 && !line.contains(':') {
            return line.split_whitespace().for_each(|part| self.take(part));
        }
        if line.is_empty() {
            return;
        }
        self.names = if line.contains([':', '=']) { vec![] } else { names(line) };
        let cut = line.find([':', '=', '\t', ';']).or_else(|| key_end(line)).or_else(|| line.find(','));
        if let Some(cut) = cut {
            let (name, value) = line.split_at(cut);
            self.pair(name, value.trim_start_matches([':', '=', ' ', '\t', ';', ',']).trim());
        }
    }

    fn pair(&mut self, name: &str, value: &str) {
        let bare =
            name.split(['[', '(', '{']).next().unwrap_or_default().trim().trim_matches(['"', '.']).to_lowercase();
        self.esri |= matches!(bare.as_str(), "xllcorner" | "xllcenter" | "yllcorner" | "yllcenter" | "nodata_value");
        let Some((key, _)) = KEYS.iter().find(|(_, names)| names.contains(&bare.as_str())) else { return };
        let parsed = quantity(value);
        let number = parsed.map(|(number, _)| number);
        let rest = parsed.map_or("", |(_, rest)| rest);
        let unit = unit_um(rest).or_else(|| unit_in(name).filter(|_| name.contains(['[', '(', '{'])));
        self.decimal_comma |= parsed.is_some_and(|_| value.contains(',') && !value.contains(", "))
            && value.split_once(',').is_some_and(|(_, after)| after.starts_with(|c: char| c.is_ascii_digit()));
        let length = number.zip(unit).map(|(n, u)| n * u).filter(|um| *um > 0.0);
        let count = || number.filter(|n| (1.0..1e6).contains(n) && n.fract() == 0.0).map(|n| n as usize);
        let problem = &mut self.problem;
        match key {
            Key::Columns if length.is_none() => set(problem, "columns", &mut self.columns, count()),
            Key::Rows if length.is_none() => set(problem, "rows", &mut self.rows, count()),
            Key::Columns | Key::Width if length.is_some() => set(problem, "width", &mut self.width_um, length),
            Key::Rows | Key::Height if length.is_some() => set(problem, "height", &mut self.height_um, length),
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

    /// `10 µm`, or `10 x 8 µm`, `10 µm × 8 µm`.
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

/// Where the name ends in `ncols 64`.
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
