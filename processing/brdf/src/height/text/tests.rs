//! Text of usual programs: read correctly, or refused as ambiguous.

use super::super::{HeightField, Scale, read};

/// Heights in nm; no row or column is evenly spaced.
const NM: [[f64; 4]; 3] = [[10.25, 31.5, 7.75, 44.0], [12.5, 90.25, 3.0, 61.125], [55.5, 20.0, 18.25, 9.5]];

fn file(bytes: &[u8], scale: &Scale) -> nacre_base::Result<HeightField> {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.txt");
    std::fs::write(&path, bytes).unwrap();
    read(&path, scale)
}

fn flags(pixel_um: f64, range_um: f64) -> Scale {
    Scale { pixel_um: Some(pixel_um), range_um: Some(range_um), ..Scale::default() }
}

/// Rows with this separator and decimal sign.
fn rows(separator: &str, decimal: &str) -> String {
    let row = |r: &[f64; 4]| r.map(|v| format!("{v:.3}").replace('.', decimal)).join(separator);
    NM.iter().map(row).collect::<Vec<_>>().join("\n")
}

fn is_patch(field: &HeightField, name: &str) {
    assert_eq!((field.width, field.height), (4, 3), "{name}");
    let [low, _] = field.ends_um();
    for (found, nm) in field.um.iter().zip(NM.as_flattened()) {
        assert!((found - low - 1e-3 * (nm - 3.0)).abs() < 1e-9, "{name}: {:?}", field.um);
    }
}

/// Reads with a scale from options only.
fn plain(bytes: &[u8], name: &str) {
    let field = file(bytes, &flags(0.3, 0.08725)).unwrap_or_else(|e| panic!("{name}: {e}"));
    is_patch(&field, name);
}

/// Reads with a scale from the header only.
fn headed(bytes: &[u8], name: &str) {
    let field = file(bytes, &Scale::default()).unwrap_or_else(|e| panic!("{name}: {e}"));
    is_patch(&field, name);
    assert!((field.pixel_um - 0.3).abs() < 1e-9, "{name}: {}", field.pixel_um);
}

fn refused(text: &str, words: &[&str]) {
    let problem = file(text.as_bytes(), &flags(0.3, 0.1)).unwrap_err().to_string();
    assert!(words.iter().all(|w| problem.contains(w)), "{text}\n{words:?}: {problem}");
}

#[test]
fn separators_and_decimal_signs() {
    for (separator, decimal) in [
        (" ", "."),
        ("\t", "."),
        (",", "."),
        (", ", "."),
        (";", "."),
        ("; ", "."),
        (" | ", "."),
        ("   ", "."),
        (" ", ","),
        ("\t", ","),
        (";", ","),
        ("; ", ","),
    ] {
        let text = rows(separator, decimal);
        plain(text.as_bytes(), &text);
        let ended = text.replace('\n', &format!("{separator}\r\n")) + separator;
        plain(ended.as_bytes(), &ended);
        plain(text.replace('\n', "\r").as_bytes(), "carriage returns");
        plain(format!("{}\n", text.replace('\n', "\n\n")).as_bytes(), "blank lines between");
    }
    plain(rows(" ", ".").replace("10.250", "1.025D+01").as_bytes(), "Fortran");
    plain(rows(",", ".").replace("10.250", "\"10.250\"").as_bytes(), "quoted");
    let exponents =
        NM.iter().map(|r| r.map(|v| format!("{v:e}").replace('.', ",")).join("\t")).collect::<Vec<_>>().join("\n");
    plain(exponents.as_bytes(), "exponents");
}

#[test]
fn encodings() {
    let text = format!("# Breite: 1,2 µm\n# Höhe: 900 nm\n# Werteeinheit: nm\n{}", rows("\t", ","));
    headed(text.as_bytes(), "UTF-8");
    headed(format!("\u{feff}{text}").as_bytes(), "UTF-8 with mark");
    let latin: Vec<u8> = text.chars().map(|c| c as u8).collect();
    headed(&latin, "Latin-1");
    let wide = |text: &str, bytes: fn(u16) -> [u8; 2]| text.encode_utf16().flat_map(bytes).collect::<Vec<u8>>();
    for (mark, name) in [("\u{feff}", "with mark"), ("", "without")] {
        let text = format!("{mark}{text}");
        headed(&wide(&text, u16::to_le_bytes), &format!("UTF-16 LE {name}"));
        headed(&wide(&text, u16::to_be_bytes), &format!("UTF-16 BE {name}"));
    }
    let odd = [wide(&format!("\u{feff}{text}"), u16::to_le_bytes), vec![0]].concat();
    assert!(file(&odd, &Scale::default()).unwrap_err().to_string().contains("truncated"));
    let quad: Vec<u8> = format!("\u{feff}{text}").chars().flat_map(|c| (c as u32).to_le_bytes()).collect();
    headed(&quad, "UTF-32");
}

#[test]
fn headers_in_many_languages() {
    for [width, height, unit] in [
        ["Width", "Height", "Value units"],
        ["Breite", "Höhe", "Werteeinheit"],
        ["Breite", "Höhe", "Einheit der Werte"],
        ["Largeur", "Hauteur", "Unités de valeur"],
        ["Ancho", "Alto", "Unidades de valor"],
        ["Larghezza", "Altezza", "Unità dei valori"],
        ["Largura", "Altura", "Unidade do valor"],
        ["Breedte", "Hoogte", "Eenheid"],
        ["Šířka", "Výška", "Jednotky hodnot"],
        ["Ширина", "Высота", "Единицы значений"],
        ["幅", "高さ", "値の単位"],
    ] {
        for (sign, decimal) in [(": ", ","), (" = ", "."), ("\t", ",")] {
            let text = format!(
                "# {width}{sign}1{decimal}2 µm\n# {height}{sign}0{decimal}9 µm\n# {unit}{sign}nm\n{}",
                rows("\t", if sign == "\t" { "," } else { "." })
            );
            headed(text.as_bytes(), &text);
        }
    }
    for header in [
        "Scan Size: 1.2 x 0.9 µm\nUnits: nm",
        "Pixelgröße: 0,3 µm\nEinheit: nm",
        "Pixel size (nm): 300\nZ unit: nm",
        "Taille de pixel : 300 nm\nUnité : nm",
        "pixel_um 0.3\nz unit nm",
        "ncols 4\nnrows 3\npixel_um 0.3\nvalue units nm",
        "\"Pixel size\";0,3;µm\n\"Unit\";nm",
        "Pixel size,0.3 µm\nUnit,nm\nDate,01.02.2024 10:30",
        "pixel size=3e-7 m\nw=4 h=3\ndata unit=rad\nheight conversion factor (-> m)=1e-9",
        "x spacing: 0.3 micrometers\ny spacing: 0.3 micrometers\nz unit: nanometers",
    ] {
        headed(format!("{header}\n{}", rows(" ", ".")).as_bytes(), header);
    }
}

#[test]
fn numbers_with_two_readings_are_refused() {
    refused("1,234\t5,678\t9,101\n2,345\t6,789\t999\n", &["1,234", "thousands"]);
    refused("1,234 5.5\n2,345 6.5\n", &["decimal points", "commas"]);
    refused("1.234,5;2.345,6\n1.234,7;2.345,8\n", &["comma and point"]);
    refused("1,234\n2,345\n3,456\n", &["1,234", "decimal signs"]);
    refused("75,000,103,701\n128,033,144,291\n", &["commas both between and inside"]);
    refused("1,5, 2,5, 3,5\n4,5, 9,5, 1,5\n", &["commas"]);
    refused("\"1,5\",\"2,5\"\n\"3,5\",\"4,5\"\n", &["quotation marks"]);
    refused("5,25,103,71\n12,33,144,29\n", &["commas"]);
    refused("1'234 5'678\n1'111 2'222\n", &["neither"]);
    // Thousands of all numbers are a common factor.
    let field = file(b"1,234\t5,678\n2,345\t6,789\n", &flags(0.3, 0.1)).unwrap();
    assert!((field.um[1] - field.um[0] - 0.1 * 4444.0 / 5555.0).abs() < 1e-9);
    let with_unit = b"Unit: nm\n1,234\t5,678\n2,345\t6,789\n";
    let scale = Scale { pixel_um: Some(0.3), ..Scale::default() };
    assert!(file(with_unit, &scale).unwrap_err().to_string().contains("thousands"));
    refused(&format!("Width: 1,200 nm\nHeight: 900 nm\nUnit: nm\n{}", rows(" ", ".")), &["1,200 nm", "thousands"]);
    // A header with decimal commas resolves the ambiguity.
    let decided = b"Breite: 0,6 \xb5m\nH\xf6he: 0,6 \xb5m\nEinheit: nm\n1,234\t5,678\n2,345\t6,789\n";
    assert!((file(decided, &Scale::default()).unwrap().range_um() - 5.555e-3).abs() < 1e-9);
}

#[test]
fn gaps_of_all_kinds_are_refused() {
    for word in [
        "NaN",
        "nan",
        "Bad",
        "BAD",
        "---",
        "--",
        "n/a",
        "#N/A",
        "1.#QNAN",
        "-1.#IND",
        "null",
        "inf",
        "NoData",
        "ungültig",
    ] {
        for separator in [" ", "\t", ";", ","] {
            let text = rows(separator, ".").replace("90.250", word);
            refused(&text, &["1 heights are gaps", "column 1, row 1"]);
        }
    }
    for separator in ["\t", ";", ","] {
        refused(&rows(separator, ".").replace("90.250", ""), &["1 heights are gaps", "column 1, row 1"]);
        refused(&rows(separator, ".").replace("9.500", ""), &["1 heights are gaps", "column 3, row 2"]);
        refused(&rows(separator, ".").replace("10.250", ""), &["1 heights are gaps", "column 0, row 0"]);
    }
    refused(&format!("{}\nNaN NaN NaN NaN\n", rows(" ", ".")), &["gaps only"]);
    refused(&format!("NaN NaN NaN NaN\n{}\n", rows(" ", ".")), &["gaps only"]);
    for [key, value] in
        [["NODATA_value", "-9999"], ["# nodata:", "-32768"], ["Fill value =", "1e10"], ["Fehlwert:", "77"]]
    {
        let text = format!("{key} {value}\n{}", rows(" ", ".").replace("90.250", value));
        refused(&text, &["1 heights are gaps", "by the header", "column 1, row 1"]);
    }
    for sentinel in ["-9999", "1.70141e38", "-32768", "3.4028235e38"] {
        refused(&rows(" ", ".").replace("90.250", sentinel), &["1 heights are", "stands for gaps"]);
    }
    let esri = |value: &str| {
        format!("ncols 4\nnrows 3\nxllcorner 0\nyllcorner 0\ncellsize 0.3\n{}", rows(" ", ".").replace("90.250", value))
    };
    plain(esri("90.250").as_bytes(), "ESRI");
    refused(&esri("-9999"), &["-9999 by the header"]);
}

#[test]
fn grids_of_esri_state_a_pitch_without_unit() {
    let text = |pitch: &str| {
        format!("NCOLS 4\nNROWS 3\nXLLCENTER 5\nYLLCENTER 5\n{pitch}\nNODATA_VALUE -9999\n{}", rows(" ", "."))
    };
    for pitch in ["cellsize 0.3", "dx 0.3\ndy 0.3", "CELLSIZE 300"] {
        plain(text(pitch).as_bytes(), pitch);
    }
    let problem = |text: String, scale: Scale| file(text.as_bytes(), &scale).unwrap_err().to_string();
    assert!(problem(text("dx 0.3\ndy 1.4"), flags(0.3, 0.1)).contains("4 : 1"));
    assert!(problem(text("cellsize 0.25"), flags(0.3, 0.1)).contains("--pixel-um says 0.3"));
    let unknown = problem(text("cellsize 0.3"), Scale { range_um: Some(0.1), ..Scale::default() });
    assert!(unknown.contains("in which unit") && unknown.contains("--pixel-um"), "{unknown}");
    assert!(problem(text("cellsize 0.3").replace("NROWS 3", "NROWS 4"), flags(0.3, 0.1)).contains("says 4"));
    // Rows may be wrapped if the header states their length.
    plain(text("cellsize 0.3").replace("31.500 ", "31.500\n").as_bytes(), "wrapped");
}

/// Points of the patch, y upwards, in this order.
fn points(order: impl Fn(usize) -> usize, separator: &str, decimal: &str) -> String {
    let line = |k: usize| {
        let (x, y) = (order(k) % 4, order(k) / 4);
        let number = |v: f64| format!("{v:.3}").replace('.', decimal);
        [number(x as f64 * 0.3 - 1.0), number((2 - y) as f64 * 0.3), number(NM[y][x])].join(separator)
    };
    (0..12).map(line).collect::<Vec<_>>().join("\n")
}

#[test]
fn points_on_a_grid_are_read_in_any_order() {
    for (separator, decimal) in [(" ", "."), ("\t", ","), (";", ","), (",", ".")] {
        for order in [|k: usize| k, |k| 11 - k, |k| (k * 5) % 12, |k| (k % 3) * 4 + k / 3] {
            let text = points(order, separator, decimal);
            plain(text.as_bytes(), &text);
        }
    }
    let named = format!("X [µm];Y [µm];Z [nm]\n{}", points(|k| k, ";", ","));
    headed(named.as_bytes(), &named);
    let swapped: String = points(|k| k, " ", ".")
        .lines()
        .map(|l| {
            let w: Vec<_> = l.split(' ').collect();
            format!("{} {} {}\n", w[2], w[0], w[1])
        })
        .collect();
    headed(format!("z/nm x/µm y/µm\n{swapped}").as_bytes(), "named columns in another order");
    let blocks = points(|k| k, " ", ".")
        .lines()
        .collect::<Vec<_>>()
        .chunks(4)
        .map(|b| b.join("\n"))
        .collect::<Vec<_>>()
        .join("\n\n");
    plain(blocks.as_bytes(), "blocks");
}

#[test]
fn points_that_are_no_grid_are_refused() {
    let whole = points(|k| k, " ", ".");
    refused(&whole.replace("-0.700 0.600", "-0.650 0.600"), &["not evenly spaced"]);
    refused(&whole.replacen("-0.700 0.600", "-1.000 0.600", 1), &["two points"]);
    let cut: Vec<_> = whole.lines().filter(|l| !l.contains("90.250")).collect();
    refused(&cut.join("\n"), &["1 heights have no point", "column 1, row 1"]);
    refused(&whole.replace("90.250", "NaN"), &["1 heights are gaps"]);
    let uneven = file(whole.as_bytes(), &flags(0.25, 0.1)).unwrap_err().to_string();
    assert!(uneven.contains("--pixel-um says 0.25"), "{uneven}");
    let more: String = whole.lines().map(|l| format!("{l} 255\n")).collect();
    refused(&more, &["points of 4 numbers"]);
    let oblong: String =
        whole.lines().map(|l| l.replacen("0.600", "0.700", 1).replacen(" 0.300", " 0.350", 1) + "\n").collect();
    let squares = file(oblong.as_bytes(), &flags(0.3, 0.1)).unwrap();
    assert!(squares.notes.iter().any(|n| n.contains("to squares")), "{:?}", squares.notes);
}

#[test]
fn profiles_are_one_row() {
    let heights: Vec<f64> = NM.as_flattened().to_vec();
    let text: String =
        heights.iter().enumerate().map(|(k, z)| format!("{:.2};{z}\n", k as f64 * 0.25).replace('.', ",")).collect();
    let field = file(format!("Abstand [µm];Höhe [nm]\n{text}").as_bytes(), &Scale::default()).unwrap();
    assert_eq!((field.width, field.height), (12, 1));
    assert!((field.pixel_um - 0.25).abs() < 1e-9 && (field.um[5] - 0.090_25).abs() < 1e-9);
    let field = file(text.as_bytes(), &flags(0.25, 0.08725)).unwrap();
    assert_eq!((field.width, field.height), (12, 1));
    refused("0 1\n1 5\n3 2\n4 2\n", &["not evenly spaced"]);
    refused("1\n5\n3\n", &["one column"]);
    let field = file(b"columns: 2\nrows: 2\n1\n5\n3\n9\n", &flags(0.3, 0.1)).unwrap();
    assert_eq!((field.width, field.height), (2, 2));
}

#[test]
fn indices_and_coordinates_are_no_heights() {
    let indexed: String = rows(" ", ".").lines().enumerate().map(|(k, l)| format!("{k} {l}\n")).collect();
    refused(&indexed, &["first column", "index"]);
    let counted = format!("0 1 2 3\n{}", rows(" ", "."));
    refused(&counted, &["first row", "index"]);
    let frame: String = std::iter::once(";0;0.3;0.6;0.9\n".to_owned())
        .chain(rows(";", ".").lines().enumerate().map(|(k, l)| format!("{};{l}\n", k as f64 * 0.3)))
        .collect();
    refused(&frame, &["first"]);
    // A common slope of all columns is part of the surface.
    let slope: String =
        (0..6).map(|y| (0..5).map(|x| format!("{} ", 2 * x + 7 * y)).collect::<String>() + "\n").collect();
    assert!(file(slope.as_bytes(), &flags(0.3, 0.1)).is_ok());
    // Narrow matrix whose header states both sizes.
    let narrow = "Width: 0.9 µm\nHeight: 1.2 µm\nUnit: nm\n1 5 2\n2 7 1\n3 1 1\n4 8 9\n";
    let field = file(narrow.as_bytes(), &Scale::default()).unwrap();
    assert_eq!((field.width, field.height), (3, 4));
    // Size before the rows.
    plain(format!("4 3\n{}", rows(" ", ".")).as_bytes(), "size first");
    refused(&format!("4 5\n{}", rows(" ", ".")), &["line 2"]);
}

#[test]
fn contradictions_and_other_tables_are_refused() {
    refused(&format!("Unit: V\n{}", rows(" ", ".")), &["values in V"]);
    refused(&format!("Unit: nm\nValue units: m\n{}", rows(" ", ".")), &["two different things", "unit"]);
    refused(&format!("Z scale: 2.5\n{}", rows(" ", ".")), &["multiplied by 2.5"]);
    refused(&format!("{0}\n\n{0}", rows(" ", ".")), &["2 blocks"]);
    refused(&format!("{0}\n# Channel 2\n{0}", rows(" ", ".")), &["line 4", "second header"]);
    refused("01.02.2024 12:30\nhello world\n", &["neither"]);
    let stated = format!("Width: 1.2 µm\nHeight: 0.9 µm\nValue units: nm\n{}", rows(" ", "."));
    let with = |pixel_um, range_um| file(stated.as_bytes(), &Scale { pixel_um, range_um, ..Scale::default() });
    assert!(with(Some(0.3), Some(0.0872)).is_ok());
    assert!(with(Some(0.4), None).unwrap_err().to_string().contains("--pixel-um says 0.4"));
    assert!(with(None, Some(87.25)).unwrap_err().to_string().contains("--range-um says 87.25"));
}

/// Damaged text gives an error or a grid.
#[test]
fn damaged_text_never_panics() {
    let rounds = std::env::var("NACRE_FUZZ_ROUNDS").ok().and_then(|n| n.parse().ok()).unwrap_or(1500);
    let wide = |text: &str| text.encode_utf16().flat_map(u16::to_le_bytes).collect::<Vec<u8>>();
    let head = format!("# Breite: 1,2 µm\n# Höhe: 900 nm\n# Werteeinheit: nm\n{}", rows("\t", ","));
    let samples = [
        head.clone().into_bytes(),
        wide(&head),
        format!("ncols 4\nnrows 3\ncellsize 0.3\nNODATA_value -9999\n{}", rows(" ", ".")).into_bytes(),
        format!("X [µm];Y [µm];Z [nm]\n{}", points(|k| k, ";", ",")).into_bytes(),
        rows(",", ".").into_bytes(),
    ];
    let path = std::path::Path::new("text");
    for (seed, whole) in samples.iter().enumerate() {
        let mut state = seed as u64 + 99;
        let mut dice = move || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 33) as usize
        };
        for round in 0..rounds {
            let mut copy = whole.clone();
            for _ in 0..=dice() % 3 {
                let at = dice() % copy.len();
                copy[at] = match dice() % 4 {
                    0 => dice() as u8,
                    1 => b"0123456789.,;\t\n e-+#"[dice() % 20],
                    2 => 0xff,
                    _ => copy[at] ^ (1 << (dice() % 8)),
                };
            }
            if round % 5 == 0 {
                copy.truncate(dice() % whole.len());
            }
            if let Ok(stored) = super::read(path, &copy, &flags(0.3, 0.1)) {
                assert_eq!(stored.values.len(), stored.width * stored.rows);
                _ = stored.field(path, &flags(0.3, 0.1));
            }
        }
    }
}

/// Gaps are filled on request, and oblong pixels become square.
#[test]
fn gaps_and_oblong_pixels_are_interpolated() {
    let grid = |gap: &str, sides: &str| {
        let row = |y: usize| -> Vec<String> {
            (0..20).map(|x| format!("{:.2}", 0.01 * x as f64 + 0.02 * y as f64)).collect()
        };
        let rows: Vec<String> = (0..10).map(|y| row(y).join(" ")).collect();
        let text = rows.join("\n").replacen("0.20", gap, 1);
        format!("ncols 20\nnrows 10\n{sides}\nNODATA_value -9999\n{text}\n")
    };
    let scale = Scale { range_um: Some(0.37), ..Scale::default() };
    let filling = Scale { fill_gaps: Some(0.01), pixel_um: Some(0.5), ..scale.clone() };
    let words = file(grid("-9999", "cellsize 0.5").as_bytes(), &scale).unwrap_err().to_string();
    assert!(
        words.contains("1 heights are gaps (-9999 by the header) (0.50 %)") && words.contains("--fill-gaps 0.005"),
        "{words}"
    );
    let filled = file(grid("-9999", "cellsize 0.5").as_bytes(), &filling).unwrap();
    let whole = file(grid("0.20", "cellsize 0.5").as_bytes(), &Scale { pixel_um: Some(0.5), ..scale.clone() }).unwrap();
    assert!(filled.um.iter().zip(&whole.um).all(|(a, b)| (a - b).abs() < 1e-9));
    assert!(filled.notes.iter().any(|n| n.contains("1 gaps (0.50 %) filled")), "{:?}", filled.notes);
    let oblong = Scale { pixel_um: Some(0.5), ..scale };
    let found = file(grid("0.20", "dx 1\ndy 0.5").as_bytes(), &oblong).unwrap();
    assert_eq!((found.width, found.height, found.pixel_um), (39, 10, 0.5));
    assert!((found.um[39 + 5] - 0.5 * (whole.um[20 + 2] + whole.um[20 + 3])).abs() < 1e-6);
    assert!(found.notes.iter().any(|n| n.contains("interpolated to squares")), "{:?}", found.notes);
    let words = file(grid("0.20", "dx 5\ndy 0.5").as_bytes(), &oblong).unwrap_err().to_string();
    assert!(words.contains("more than 4 : 1") && words.contains("every 10th point"), "{words}");
}
