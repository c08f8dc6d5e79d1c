//! X3P archives (ISO 25178-72, earlier ISO 5436-2): a ZIP archive of `main.xml` and the heights, as a binary file or a
//! list in the XML. Lengths are in metres; the first row is the lowest.

use super::super::stored::{Pitch, Stored};
use super::bytes::{Kind, Order, numbers};
use super::fault::{Fault, Outcome};
use super::{Input, size};
use roxmltree::{Document, Node};
use std::io::{Cursor, Read};
use zip::ZipArchive;
use zip::result::ZipError;

/// Largest `main.xml` in bytes and nodes, and largest number of files of an archive. The XML may hold the heights, two
/// nodes each, in half a GiB of memory.
const MAX_XML: u64 = 64 << 20;
const MAX_NODES: u32 = 8 << 20;
const MAX_FILES: usize = 4096;

/// Smallest ratio of the roughness of the wrong to the right signedness of integers.
const ROUGHER: f64 = 4.0;

type Archive<'a> = ZipArchive<Cursor<&'a [u8]>>;

pub(super) fn is(bytes: &[u8]) -> bool {
    // Names of files are not compressed.
    bytes.starts_with(b"PK\x03\x04") && bytes.windows(8).any(|name| name.eq_ignore_ascii_case(b"main.xml"))
}

pub(super) fn read(input: &Input) -> Outcome<Stored> {
    let read = || {
        let mut archive = ZipArchive::new(Cursor::new(input.bytes)).map_err(broken)?;
        if archive.len() > MAX_FILES {
            return Err(Fault::damaged("its archive holds too many files"));
        }
        let names =
            archive.file_names().map(|n| n.map(|n| n.into_owned())).collect::<Result<Vec<_>, _>>().map_err(broken)?;
        let Some(main) =
            names.iter().find(|n| n.eq_ignore_ascii_case("main.xml") || n.to_lowercase().ends_with("/main.xml"))
        else {
            return Err(Fault::unsupported(
                "it is another ZIP archive, without main.xml",
                "export the heights as X3P or text",
            ));
        };
        let bytes = entry(&mut archive, main, MAX_XML)?;
        let xml = String::from_utf8(bytes).map_err(|_| Fault::damaged("main.xml is no UTF-8 text"))?;
        let options = roxmltree::ParsingOptions { nodes_limit: MAX_NODES, ..Default::default() };
        let xml = Document::parse_with_options(xml.trim_start_matches('\u{feff}'), options).map_err(|e| match e {
            roxmltree::Error::NodesLimitReached => {
                Fault::unsupported("its list of heights is too long", "export it with binary heights")
            }
            other => Fault::damaged(format!("main.xml: {other}")),
        })?;
        document(&xml, &mut archive, main.trim_end_matches(|c| c != '/'))
    };
    nacre_base::guard::guarded(read).unwrap_or_else(|panic| Err(Fault::Damaged(format!("it {panic}"))))
}

fn broken(error: ZipError) -> Fault {
    match error {
        ZipError::UnsupportedArchive(feature) => {
            Fault::unsupported(feature.to_string(), "pack the archive again with Deflate")
        }
        ZipError::Io(error) => Fault::Truncated(error.to_string()),
        other => Fault::damaged(other.to_string()),
    }
}

/// Reads a file of the archive, at most `most` bytes.
fn entry(archive: &mut Archive, name: &str, most: u64) -> Outcome<Vec<u8>> {
    let file = archive.by_name(name).map_err(|error| match error {
        ZipError::FileNotFound => Fault::damaged(format!("its archive has no {name:.80}")),
        other => broken(other),
    })?;
    if file.size() > most {
        return Err(Fault::damaged(format!("{name:.80} has {} bytes, at most {most} expected", file.size())));
    }
    let mut bytes = Vec::new();
    let read = file.take(most + 1).read_to_end(&mut bytes);
    read.map_err(|e| Fault::damaged(format!("{name:.80}: {e}")))?;
    if bytes.len() as u64 > most {
        return Err(Fault::damaged(format!("{name:.80} is larger than its archive says")));
    }
    Ok(bytes)
}

/// Child element of this name, in any namespace.
fn child<'a>(node: Node<'a, 'a>, name: &str) -> Option<Node<'a, 'a>> {
    node.children().find(|c| c.is_element() && c.tag_name().name() == name)
}

fn need<'a>(node: Node<'a, 'a>, name: &str) -> Outcome<Node<'a, 'a>> {
    child(node, name).ok_or_else(|| Fault::damaged(format!("main.xml has no {name} in {}", node.tag_name().name())))
}

fn text<'a>(node: Node<'a, 'a>, name: &str) -> Option<&'a str> {
    child(node, name).and_then(|n| n.text()).map(str::trim).filter(|t| !t.is_empty())
}

fn number(node: Node, name: &str) -> Outcome<Option<f64>> {
    let parse =
        |text: &str| text.parse::<f64>().map_err(|_| Fault::damaged(format!("{name} is {text:.40}, no number")));
    text(node, name).map(parse).transpose()
}

/// Axis: absolute or incremental, its type of numbers, and increment and offset in m.
struct Axis {
    incremental: bool,
    kind: Option<Kind>,
    increment: Option<f64>,
    offset: f64,
}

impl Axis {
    fn read<'a>(axes: Node<'a, 'a>, name: &str) -> Outcome<Self> {
        let node = need(axes, name)?;
        let kind = match text(node, "DataType") {
            None => None,
            Some("I") => Some(Kind::I16),
            Some("L") => Some(Kind::I32),
            Some("F") => Some(Kind::F32),
            Some("D") => Some(Kind::F64),
            Some(other) => return Err(Fault::damaged(format!("{name} has the unknown data type {other:.8}"))),
        };
        let incremental = match text(node, "AxisType") {
            Some("I") => true,
            Some("A") => false,
            other => {
                return Err(Fault::damaged(format!(
                    "{name} has the unknown axis type {:.8}",
                    other.unwrap_or_default()
                )));
            }
        };
        let increment = number(node, "Increment")?;
        Ok(Self { incremental, kind, increment, offset: number(node, "Offset")?.unwrap_or(0.0) })
    }
}

fn document<'a>(xml: &'a Document<'a>, archive: &mut Archive, folder: &str) -> Outcome<Stored> {
    let root = xml.root_element();
    let record = need(root, "Record1")?;
    let points = "it is a cloud of points without a grid";
    let remedy = "export a surface on a regular grid (feature type SUR)";
    if text(record, "FeatureType") == Some("PCL") {
        return Err(Fault::unsupported(points, remedy));
    }
    let axes = need(record, "Axes")?;
    let (x, y, z) = (Axis::read(axes, "CX")?, Axis::read(axes, "CY")?, Axis::read(axes, "CZ")?);
    rotation(axes)?;
    let data = need(root, "Record3")?;
    let Some(matrix) = child(data, "MatrixDimension") else {
        return Err(Fault::unsupported(points, remedy));
    };
    let count =
        |name: &str| Ok(number(matrix, name)?.ok_or_else(|| Fault::damaged(format!("main.xml has no {name}")))? as i64);
    let (width, rows) = size(count("SizeX")?, count("SizeY")?)?;
    if count("SizeZ")? != 1 {
        return Err(Fault::unsupported("it has several layers", "export one layer"));
    }
    let profile = rows == 1 && text(record, "FeatureType") == Some("PRF");
    if !x.incremental || !(y.incremental || profile) || z.incremental {
        return Err(Fault::unsupported("its x and y are not on a regular grid (axis types)", remedy));
    }
    let list = child(data, "DataList");
    let (values, kind) = match (list, child(data, "DataLink")) {
        (Some(list), _) => (datums(list, width * rows)?, Kind::F64),
        (None, Some(link)) => linked(link, archive, folder, &z, [width, rows])?,
        (None, None) => return Err(Fault::damaged("main.xml has neither DataLink nor DataList")),
    };
    let scale = z.increment.filter(|i| *i != 0.0).unwrap_or(1.0);
    // A common height offset does not affect diffraction, and its omission reduces rounding errors.
    let _ = z.offset;
    let step =
        |axis: &Axis| axis.increment.filter(|i| *i > 0.0).ok_or_else(|| Fault::damaged("an axis has no increment"));
    let across = step(&x)?;
    let down = if rows > 1 { step(&y)? } else { across };
    Ok(Stored {
        width,
        rows,
        values,
        pitch: Pitch::Um([across * 1e6, down * 1e6]),
        unit_um: Some(scale * 1e6),
        step: kind.is_integer().then_some(1.0),
        notes: vec![format!(
            "X3P file, {}, y upwards",
            if list.is_some() { "list of heights" } else { "binary heights" }
        )],
        gaps: Some("are invalid points".into()),
    }
    .upside_down())
}

/// Refuses rotated axes.
fn rotation<'a>(axes: Node<'a, 'a>) -> Outcome<()> {
    let Some(node) = child(axes, "Rotation") else { return Ok(()) };
    for (k, name) in ["r11", "r12", "r13", "r21", "r22", "r23", "r31", "r32", "r33"].into_iter().enumerate() {
        let unit = f64::from(u8::from(k % 4 == 0));
        if number(node, name)?.is_some_and(|r| (r - unit).abs() > 1e-6) {
            return Err(Fault::unsupported("its axes are rotated", "export it in the axes of the measurement"));
        }
    }
    Ok(())
}

/// Heights of the list in the XML: `x;y;z`, or z alone; empty for invalid points.
fn datums<'a>(list: Node<'a, 'a>, count: usize) -> Outcome<Vec<f64>> {
    let mut values = Vec::with_capacity(count.min(1 << 20));
    for node in list.children().filter(|c| c.is_element() && c.tag_name().name() == "Datum") {
        let text = node.text().unwrap_or_default();
        let height = text.rsplit(';').next().unwrap_or_default().trim();
        let value = if height.is_empty() { Ok(f64::NAN) } else { height.parse::<f64>() };
        values.push(value.map_err(|_| Fault::damaged(format!("a datum is {text:.40}")))?);
    }
    match values.len() {
        n if n == count => Ok(values),
        n if n < count => Err(Fault::Truncated(format!("{count} heights expected, {n} found"))),
        n => Err(Fault::damaged(format!("{count} heights expected, {n} found"))),
    }
}

/// Heights of the binary file, NaN where the file of valid points marks them invalid.
fn linked<'a>(
    link: Node<'a, 'a>,
    archive: &mut Archive,
    folder: &str,
    z: &Axis,
    [width, rows]: [usize; 2],
) -> Outcome<(Vec<f64>, Kind)> {
    let count = width * rows;
    let kind = z.kind.ok_or_else(|| Fault::damaged("CZ has no data type"))?;
    let mut file = |name: &str, most: usize| {
        let name = name.trim_start_matches("./").replace('\\', "/");
        let inside = format!("{folder}{name}");
        let known = archive.index_for_name(&inside).is_some();
        entry(archive, if known { &inside } else { &name }, most as u64)
    };
    let name = text(link, "PointDataLink").ok_or_else(|| Fault::damaged("main.xml has no PointDataLink"))?;
    // Some programs pad the file.
    let bytes = file(name, count * kind.size() + 4096)?;
    let mut values = match kind {
        Kind::I16 => signed(numbers(&bytes, count, Kind::I16, Order::Little)?, 65536.0, width)?,
        Kind::I32 => signed(numbers(&bytes, count, Kind::I32, Order::Little)?, 4_294_967_296.0, width)?,
        kind => numbers(&bytes, count, kind, Order::Little)?,
    };
    if let Some(name) = text(link, "ValidPointsLink") {
        let valid = file(name, count.div_ceil(8) + 4096)?;
        if valid.len() < count.div_ceil(8) {
            return Err(Fault::Truncated(format!("{name:.80} has {} bytes", valid.len())));
        }
        let invalid = |(k, _): &(usize, &mut f64)| valid[k / 8] >> (k % 8) & 1 == 0;
        values.iter_mut().enumerate().filter(invalid).for_each(|(_, v)| *v = f64::NAN);
    }
    Ok((values, kind))
}

/// Signedness of integers: signed by the standard, unsigned in some programs. If the results differ, the smoother
/// surface is taken.
fn signed(values: Vec<f64>, full: f64, width: usize) -> Outcome<Vec<f64>> {
    if values.iter().all(|v| *v >= 0.0) || values.iter().all(|v| *v < 0.0) {
        return Ok(values);
    }
    let unsigned: Vec<f64> = values.iter().map(|v| if *v < 0.0 { v + full } else { *v }).collect();
    let steps = |values: &[f64], to: usize| {
        values.iter().zip(&values[to.min(values.len())..]).map(|(a, b)| (b - a).abs()).sum::<f64>()
    };
    // Steps to the right (also from the end of a row to the next row) and down.
    let rough = |values: &[f64]| steps(values, 1) + steps(values, width);
    let (a, b) = (rough(&values), rough(&unsigned));
    if b >= a * ROUGHER {
        return Ok(values);
    }
    if a >= b * ROUGHER {
        return Ok(unsigned);
    }
    let problem = "its integers may be signed or unsigned, and both give a surface";
    Err(Fault::unsupported(problem, "export the heights as floats (data type F or D)"))
}
