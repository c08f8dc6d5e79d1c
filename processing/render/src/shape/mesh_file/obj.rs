//! Wavefront OBJ: polygons with texture coordinates and normals. Materials are ignored.

use super::draft::{Combinations, Draft, check_count};
use super::fault::{Decoded, Fault};
use super::text;
use crate::shape::mesh::Corner;
use crate::vector::V3;
use std::collections::BTreeSet;

const CORRECT: &str = "correct the line, or export the mesh again";

/// Index of a missing texture coordinate or normal.
const NONE: u32 = u32::MAX;

/// Ignored statements, and the names under which they are counted.
const LEFT_OUT: [(&str, &str); 9] = [
    ("l", "line"),
    ("p", "point"),
    ("curv", "curve"),
    ("curv2", "curve"),
    ("surf", "curved surface (surf)"),
    ("bzp", "curved surface (bzp)"),
    ("bsp", "curved surface (bsp)"),
    ("call", "call of another file"),
    ("csh", "shell command"),
];

/// Positions, texture coordinates, normals and faces of a file.
#[derive(Default)]
struct Statements {
    places: Vec<V3>,
    uvs: Vec<[f64; 2]>,
    normals: Vec<V3>,
    /// Position, texture coordinate and normal of each corner of the faces, counted from zero.
    corners: Vec<[u32; 3]>,
    /// End of each face in `corners`, and its line.
    faces: Vec<(usize, usize)>,
    materials: BTreeSet<String>,
}

pub(super) fn read(bytes: &[u8], draft: &mut Draft) -> Decoded<()> {
    let text = text(bytes);
    let mut all = Statements::default();
    for (number, line) in Lines::new(&text) {
        all.read(&line, number, draft)?;
    }
    draft.left_out.add("material (materials are the scene's)", all.materials.len());
    all.build(draft)
}

fn bad(line: usize, problem: impl std::fmt::Display) -> Fault {
    Fault::refused(format!("line {line}: {problem}"), CORRECT)
}

impl Statements {
    fn read(&mut self, line: &str, number: usize, draft: &mut Draft) -> Decoded<()> {
        let (keyword, rest) = line.split_once(char::is_whitespace).unwrap_or((line, ""));
        match keyword {
            "v" => {
                check_count("vertices", self.places.len() + 1)?;
                let [x, y, z] = numbers(rest, 3, number)?;
                self.places.push(V3::new(x, y, z));
            }
            "vt" => {
                check_count("texture coordinates", self.uvs.len() + 1)?;
                let [u, v, _] = numbers(rest, 1, number)?;
                self.uvs.push([u, v]);
            }
            "vn" => {
                check_count("normals", self.normals.len() + 1)?;
                let [x, y, z] = numbers(rest, 3, number)?;
                self.normals.push(V3::new(x, y, z));
            }
            "f" | "fo" => {
                for corner in rest.split_whitespace() {
                    check_count("corners of faces", self.corners.len() + 1)?;
                    let corner = self.corner(corner).map_err(|problem| bad(number, problem))?;
                    self.corners.push(corner);
                }
                self.faces.push((self.corners.len(), number));
            }
            "usemtl" => {
                let name = rest.trim();
                if !name.is_empty() {
                    self.materials.insert(name.to_owned());
                }
            }
            _ => {
                let known = LEFT_OUT.iter().find(|(word, _)| *word == keyword);
                let count = if keyword == "p" { rest.split_whitespace().count() } else { 1 };
                known.into_iter().for_each(|(_, name)| draft.left_out.add(name, count));
            }
        }
        Ok(())
    }

    /// Indices of a corner such as `3`, `3/1`, `3//2`, `3/1/2` or `-1/-1/-1`.
    fn corner(&self, text: &str) -> Result<[u32; 3], String> {
        let counts = [self.places.len(), self.uvs.len(), self.normals.len()];
        let mut numbers = [NONE; 3];
        let parts: Vec<&str> = text.split('/').collect();
        if parts.len() > 3 || parts[0].is_empty() {
            return Err(format!("{text:?} is no corner of a face, which is VERTEX/TEXTURE/NORMAL"));
        }
        for ((part, count), number) in parts.iter().zip(counts).zip(&mut numbers) {
            if part.is_empty() {
                continue;
            }
            let index: i64 = part.parse().map_err(|_| format!("{part:?} in {text:?} is no whole number"))?;
            // Negative indices count back from the last statement so far; positive ones may refer to later statements.
            let index = if index < 0 { count as i64 + index } else { index - 1 };
            *number = u32::try_from(index).ok().filter(|k| *k != NONE).ok_or_else(|| match part.trim() {
                "0" => format!("{text:?} has the number 0; numbers begin with 1"),
                _ if index < 0 => format!("{text:?} names a statement before the first of {count}"),
                _ => format!("{text:?} names vertex {part} of {count}"),
            })?;
        }
        Ok(numbers)
    }

    fn build(self, draft: &mut Draft) -> Decoded<()> {
        let mut known = Combinations::default();
        let mut begin = 0;
        let mut face = vec![];
        let [mut missing_uvs, mut missing_normals] = [0; 2];
        for (end, line) in self.faces {
            face.clear();
            for key @ [place, uv, normal] in self.corners[begin..end].iter().copied() {
                let missing = || {
                    let count = self.places.len();
                    bad(line, format!("the face names vertex {} of {count}", u64::from(place) + 1))
                };
                let place = *self.places.get(place as usize).ok_or_else(missing)?;
                let (of_uv, of_normal) = (self.uvs.get(uv as usize), self.normals.get(normal as usize));
                missing_uvs += usize::from(uv != NONE && of_uv.is_none());
                missing_normals += usize::from(normal != NONE && of_normal.is_none());
                let (uv, normal) = (of_uv.copied(), of_normal.copied());
                face.push(known.corner(key, draft, || Corner { place, normal, tangent: None, uv })?);
            }
            begin = end;
            draft.face(&face)?;
        }
        draft.left_out.add("reference to a missing texture coordinate", missing_uvs);
        draft.left_out.add("reference to a missing normal", missing_normals);
        Ok(())
    }
}

/// The first three numbers of a statement, of which `least` are required; further ones (weights, colours) are ignored.
fn numbers(text: &str, least: usize, line: usize) -> Decoded<[f64; 3]> {
    let mut numbers = [0.0; 3];
    let mut count = 0;
    for (word, number) in text.split_whitespace().zip(&mut numbers) {
        let parsed = word.parse().ok().filter(|v: &f64| v.is_finite());
        *number = parsed.ok_or_else(|| bad(line, format!("{word:?} is no number")))?;
        count += 1;
    }
    if count < least {
        return Err(bad(line, format!("{count} numbers where {least} are needed")));
    }
    Ok(numbers)
}

/// Logical lines with the number of their first physical line: without comments, and joined after a trailing backslash.
struct Lines<'a> {
    rest: &'a str,
    number: usize,
}

impl<'a> Lines<'a> {
    fn new(text: &'a str) -> Self {
        Self { rest: text, number: 0 }
    }

    /// The next physical line; lines end in LF, CR or both.
    fn physical(&mut self) -> Option<&'a str> {
        if self.rest.is_empty() {
            return None;
        }
        self.number += 1;
        let end = self.rest.find(['\n', '\r']).unwrap_or(self.rest.len());
        let (line, rest) = self.rest.split_at(end);
        self.rest = rest.strip_prefix("\r\n").or(rest.strip_prefix(['\n', '\r'])).unwrap_or(rest);
        Some(line)
    }
}

impl<'a> Iterator for Lines<'a> {
    type Item = (usize, std::borrow::Cow<'a, str>);

    fn next(&mut self) -> Option<Self::Item> {
        let (first, named) = statement(self.physical()?);
        let number = self.number;
        let Some(begun) = first.strip_suffix('\\').filter(|_| !named) else {
            return Some((number, first.into()));
        };
        let mut whole = begun.to_owned();
        while let Some(next) = self.physical() {
            let (next, _) = statement(next);
            whole.push(' ');
            whole.push_str(next.strip_suffix('\\').unwrap_or(next));
            if !next.ends_with('\\') {
                break;
            }
        }
        Some((number, whole.trim().to_owned().into()))
    }
}

/// A trimmed line without its comment, and whether it is a name: names may contain `#` and end in a backslash.
fn statement(line: &str) -> (&str, bool) {
    let line = line.trim();
    let keyword = line.split_whitespace().next().unwrap_or_default();
    match ["usemtl", "mtllib", "g", "o"].contains(&keyword) {
        true => (line, true),
        false => (line.split('#').next().unwrap_or_default().trim_end(), false),
    }
}
