//! PLY: vertices, faces and triangle strips, as text or binary.

use super::draft::{Combinations, Draft, check_count, missing_corner};
use super::fault::{Decoded, Fault};
use super::ply_header::{Element, Encoding, Header, Kind, Property, header};
use crate::shape::mesh::Corner;
use crate::vector::V3;

/// Names of a face's vertex list.
const VERTICES: [&str; 3] = ["vertex_indices", "vertex_index", "vertex_indexes"];

/// Index that ends a part of a triangle strip.
const RESTART: f64 = -1.0;

pub(super) fn read(bytes: &[u8], draft: &mut Draft) -> Decoded<()> {
    let header = header(bytes)?;
    let refusal = match read_with(bytes, &header, true, draft) {
        Err(refusal) if header.encoding == Encoding::Ascii => refusal,
        result => return result,
    };
    // A text file may also have several elements per line.
    *draft = Draft::default();
    read_with(bytes, &header, false, draft).map_err(|_| refusal)
}

/// Reads the elements; with `lines` each has its own line of a text file.
fn read_with(bytes: &[u8], header: &Header, lines: bool, draft: &mut Draft) -> Decoded<()> {
    let mut values = Values { lines, ..Values::new(bytes, header) };
    let mut lists = Lists::default();
    for element in &header.elements {
        check_promise(element, header, values.remaining())?;
        match element.name.as_str() {
            "vertex" => vertices(element, &mut values, draft)?,
            "face" => faces(element, &mut values, &mut lists)?,
            "tristrips" => strips(element, &mut values, &mut lists)?,
            name => {
                draft.left_out.add(&left_out_name(name), element.count);
                if !element.properties.is_empty() {
                    each(element, &mut values, |_, _| Ok(()), |_, _| Ok(()), || Ok(()))?;
                }
            }
        }
    }
    draft.left_out.add("line with surplus values", values.surplus);
    lists.build(draft)
}

fn left_out_name(element: &str) -> String {
    if element == "edge" { "line".into() } else { format!("element of kind {element:?}") }
}

/// Refuses element counts that the rest of the file cannot hold, before they are allocated.
fn check_promise(element: &Element, header: &Header, remaining: usize) -> Decoded<()> {
    let least = |p: &Property| match header.encoding {
        // A digit, and a space or the end of the line.
        Encoding::Ascii => 2,
        _ => p.length.unwrap_or(p.kind).bytes(),
    };
    let bytes: usize = element.properties.iter().map(least).sum();
    // The last value of a text needs no space after it.
    if element.count.saturating_mul(bytes) > remaining + 1 {
        let problem = format!("promises {} elements of kind {:?} in {remaining} bytes", element.count, element.name);
        return Err(Fault::damaged(problem));
    }
    Ok(())
}

/// Reads all elements: calls `value` for each number and `list` for each list (both with the property's index), then
/// `end`.
fn each(
    element: &Element,
    values: &mut Values,
    mut value: impl FnMut(usize, f64) -> Decoded<()>,
    mut list: impl FnMut(usize, &[f64]) -> Decoded<()>,
    mut end: impl FnMut() -> Decoded<()>,
) -> Decoded<()> {
    let mut all = vec![];
    for _ in 0..element.count {
        for (k, property) in element.properties.iter().enumerate() {
            let Some(length) = property.length else {
                value(k, values.number(property.kind)?)?;
                continue;
            };
            let length = values.number(length)?;
            if length < 0.0 || length.fract() != 0.0 || length > values.remaining() as f64 {
                return Err(values.damaged(format!("a list {} of {length} numbers", property.name)));
            }
            all.clear();
            for _ in 0..length as usize {
                all.push(values.number(property.kind)?);
            }
            list(k, &all)?;
        }
        values.end_line();
        end()?;
    }
    Ok(())
}

/// Columns of the used vertex properties.
struct Columns {
    place: [usize; 3],
    normal: Option<[usize; 3]>,
    tangent: Option<[usize; 3]>,
    uv: Option<[usize; 2]>,
}

impl Columns {
    fn of(element: &Element) -> Decoded<Self> {
        let find = |name: &str| element.properties.iter().position(|p| p.length.is_none() && p.name == name);
        let three = |[a, b, c]: [&str; 3]| Some([find(a)?, find(b)?, find(c)?]);
        let two = |[a, b]: [&str; 2]| Some([find(a)?, find(b)?]);
        let place = three(["x", "y", "z"]);
        let uvs = [["u", "v"], ["s", "t"], ["texture_u", "texture_v"], ["texture_s", "texture_t"]];
        Ok(Self {
            place: place.ok_or_else(|| Fault::damaged("has vertices without x, y and z"))?,
            normal: three(["nx", "ny", "nz"]),
            tangent: three(["tx", "ty", "tz"]),
            uv: uvs.into_iter().find_map(two),
        })
    }
}

fn vertices(element: &Element, values: &mut Values, draft: &mut Draft) -> Decoded<()> {
    check_count("vertices", element.count)?;
    let columns = Columns::of(element)?;
    let row = std::cell::RefCell::new(vec![0.0; element.properties.len()]);
    let value = |k: usize, v: f64| {
        row.borrow_mut()[k] = v;
        Ok(())
    };
    let end = || {
        let row = row.borrow();
        let three = |[a, b, c]: [usize; 3]| V3::new(row[a], row[b], row[c]);
        let corner = Corner {
            place: three(columns.place),
            normal: columns.normal.map(three),
            tangent: columns.tangent.map(three),
            uv: columns.uv.map(|[a, b]| [row[a], row[b]]),
        };
        draft.corner(corner).map(drop)
    };
    each(element, values, value, |_, _| Ok(()), end)
}

/// Vertices of faces and strips; they may precede the vertices themselves.
#[derive(Default)]
struct Lists {
    vertices: Vec<u32>,
    /// Texture coordinates of the faces' corners, as many as `vertices` or none.
    uvs: Vec<[f64; 2]>,
    /// End of each face in `vertices`.
    faces: Vec<usize>,
    strips: Vec<Vec<u32>>,
}

/// The vertex list among the lists of an element.
fn vertices_of(element: &Element) -> Decoded<usize> {
    let found = element.properties.iter().position(|p| p.length.is_some() && VERTICES.contains(&p.name.as_str()));
    found.ok_or_else(|| {
        let names: Vec<&str> = element.properties.iter().map(|p| p.name.as_str()).collect();
        let problem = format!("has elements {:?} with {} and without vertex_indices", element.name, names.join(", "));
        Fault::refused(problem, "export the mesh with a list vertex_indices")
    })
}

fn number(value: f64) -> Decoded<u32> {
    let valid = value >= 0.0 && value.fract() == 0.0 && value < f64::from(u32::MAX);
    if valid { Ok(value as u32) } else { Err(Fault::damaged(format!("has a face with vertex {value}"))) }
}

fn faces(element: &Element, values: &mut Values, lists: &mut Lists) -> Decoded<()> {
    if element.count == 0 {
        return Ok(());
    }
    let column = vertices_of(element)?;
    let uv_column = element.properties.iter().position(|p| p.length.is_some() && p.name == "texcoord");
    let list = |k: usize, list: &[f64]| {
        if k == column {
            check_count("corners of faces", lists.vertices.len() + list.len())?;
            list.iter().try_for_each(|v| number(*v).map(|v| lists.vertices.push(v)))?;
            lists.faces.push(lists.vertices.len());
        } else if Some(k) == uv_column {
            lists.uvs.extend(list.as_chunks::<2>().0);
        }
        Ok(())
    };
    each(element, values, |_, _| Ok(()), list, || Ok(()))?;
    // Files without a texture may have empty lists.
    if lists.uvs.len() != lists.vertices.len() && !lists.uvs.is_empty() {
        let problem = format!("has {} corners of faces and {} texcoord", lists.vertices.len(), lists.uvs.len());
        return Err(Fault::damaged(problem));
    }
    Ok(())
}

fn strips(element: &Element, values: &mut Values, lists: &mut Lists) -> Decoded<()> {
    let column = vertices_of(element)?;
    // Unsigned lists use the largest number in place of -1.
    let restart = match element.properties[column].kind {
        Kind::U32 => f64::from(u32::MAX),
        Kind::U16 => f64::from(u16::MAX),
        Kind::U8 => f64::from(u8::MAX),
        _ => RESTART,
    };
    let list = |k: usize, list: &[f64]| {
        if k == column {
            for part in list.split(|v| *v == restart).filter(|part| !part.is_empty()) {
                lists.strips.push(part.iter().map(|v| number(*v)).collect::<Decoded<_>>()?);
            }
        }
        Ok(())
    };
    each(element, values, |_, _| Ok(()), list, || Ok(()))
}

impl Lists {
    fn build(self, draft: &mut Draft) -> Decoded<()> {
        let count = draft.corners.len();
        if let Some(lost) = self.vertices.iter().chain(self.strips.iter().flatten()).find(|v| **v as usize >= count) {
            return Err(missing_corner(*lost as usize, count));
        }
        if self.faces.is_empty() && self.strips.is_empty() {
            draft.left_out.add("point", count);
        }
        let mut corners = self.vertices;
        let mut known = Combinations::default();
        for (corner, uv) in corners.iter_mut().zip(self.uvs) {
            let own = draft.corners[*corner as usize];
            let key = (*corner, uv.map(f64::to_bits));
            *corner = known.corner(key, draft, || Corner { uv: Some(uv), ..own })?;
        }
        let mut begin = 0;
        for end in self.faces {
            draft.face(&corners[begin..end])?;
            begin = end;
        }
        self.strips.iter().try_for_each(|strip| draft.strip(strip))
    }
}

/// The numbers of a file in sequence.
struct Values<'a> {
    encoding: Encoding,
    bytes: &'a [u8],
    at: usize,
    /// Lines read so far, of text files.
    line: usize,
    /// Whether each element has its own line of a text file.
    lines: bool,
    /// Lines with more values than their element has.
    surplus: usize,
}

impl<'a> Values<'a> {
    fn new(bytes: &'a [u8], header: &Header) -> Self {
        Self { encoding: header.encoding, bytes, at: header.bytes, line: header.lines + 1, lines: true, surplus: 0 }
    }

    fn remaining(&self) -> usize {
        self.bytes.len() - self.at
    }

    fn damaged(&self, problem: String) -> Fault {
        match self.encoding {
            Encoding::Ascii => Fault::damaged(format!("line {}: {problem}", self.line)),
            _ => Fault::damaged(format!("byte {}: {problem}", self.at)),
        }
    }

    fn number(&mut self, kind: Kind) -> Decoded<f64> {
        if self.encoding == Encoding::Ascii {
            return self.word();
        }
        let end = self.at + kind.bytes();
        let bytes = self.bytes.get(self.at..end).ok_or_else(|| self.damaged("the file ends too early".into()))?;
        self.at = end;
        // Little endian in all cases.
        let mut own = [0_u8; 8];
        let own = &mut own[..bytes.len()];
        own.copy_from_slice(bytes);
        if self.encoding == Encoding::BigEndian {
            own.reverse();
        }
        Ok(match (kind, &*own) {
            (Kind::I8, [a]) => f64::from(*a as i8),
            (Kind::U8, [a]) => f64::from(*a),
            (Kind::I16, [a, b]) => f64::from(i16::from_le_bytes([*a, *b])),
            (Kind::U16, [a, b]) => f64::from(u16::from_le_bytes([*a, *b])),
            (Kind::I32, [a, b, c, d]) => f64::from(i32::from_le_bytes([*a, *b, *c, *d])),
            (Kind::U32, [a, b, c, d]) => f64::from(u32::from_le_bytes([*a, *b, *c, *d])),
            (Kind::F32, [a, b, c, d]) => f64::from(f32::from_le_bytes([*a, *b, *c, *d])),
            (_, bytes) => f64::from_le_bytes(bytes.try_into().unwrap_or_default()),
        })
    }

    /// Skips to the end of the line of a text file if each element has its own; surplus values are counted.
    fn end_line(&mut self) {
        if self.lines && self.encoding == Encoding::Ascii {
            let rest = self.bytes[self.at..].iter().take_while(|b| !matches!(b, b'\n' | b'\r'));
            let rest: &[u8] = &self.bytes[self.at..self.at + rest.count()];
            self.surplus += usize::from(!rest.trim_ascii().is_empty());
            self.at += rest.len();
        }
    }

    fn word(&mut self) -> Decoded<f64> {
        let space = |b: &u8| b.is_ascii_whitespace() || *b == 0x0b;
        let skipped = self.bytes[self.at..].iter().take_while(|b| space(b)).count();
        self.line += self.bytes[self.at..self.at + skipped].iter().filter(|b| **b == b'\n').count();
        self.at += skipped;
        let length = self.bytes[self.at..].iter().take_while(|b| !space(b)).count();
        if length == 0 {
            return Err(self.damaged("the file ends too early".into()));
        }
        let word = String::from_utf8_lossy(&self.bytes[self.at..self.at + length]).into_owned();
        self.at += length;
        word.parse().map_err(|_| self.damaged(format!("{word:?} is no number")))
    }
}
