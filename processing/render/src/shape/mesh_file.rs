//! Meshes from OBJ, PLY and glTF files.

use crate::scene::inside;
use crate::shape::mesh::{Corner, MOST_TRIANGLES, Raw};
use crate::vector::V3;
use base64::Engine;
use nacre_base::guard::guarded;
use nacre_base::{Error, Result};
use ply_rs_bw::parser::Parser;
use ply_rs_bw::ply::{DefaultElement, Property};
use std::io::Read;
use std::path::Path;

/// Largest file, in bytes.
const MAX_BYTES: u64 = 1 << 30;

const REMEDY: &str = "give an OBJ, PLY or glTF (.gltf, .glb) file of triangles";

/// Reads a mesh.
///
/// # Errors
/// `Input` for what is none, damaged, or too large.
pub(crate) fn read(path: &Path) -> Result<Raw> {
    let ending = path.extension().map(|e| e.to_string_lossy().to_lowercase()).unwrap_or_default();
    let bytes = bytes(path)?;
    let bad = |problem: String| Error::file(path, problem, REMEDY);
    let decode = || match ending.as_str() {
        "obj" => obj(&bytes).map_err(bad),
        "ply" => ply(&bytes).map_err(bad),
        "gltf" | "glb" => gltf(&bytes, path),
        _ => Err(bad(format!("ends in {ending:?}"))),
    };
    let (corners, triangles) = guarded(decode).unwrap_or_else(|panic| Err(bad(panic)))?;
    Ok(Raw { name: path.display().to_string(), corners, triangles })
}

fn bytes(path: &Path) -> Result<Vec<u8>> {
    let cannot = |e: std::io::Error| Error::file(path, format!("cannot be read: {e}"), REMEDY);
    let info = std::fs::metadata(path).map_err(cannot)?;
    if !info.is_file() {
        return Err(Error::file(path, "is no file", REMEDY));
    }
    if info.len() > MAX_BYTES {
        let problem = format!("has {} bytes", info.len());
        return Err(Error::file(path, problem, format!("give a mesh of at most {} MiB", MAX_BYTES >> 20)));
    }
    let mut bytes = vec![];
    std::fs::File::open(path).map_err(cannot)?.take(MAX_BYTES).read_to_end(&mut bytes).map_err(cannot)?;
    Ok(bytes)
}

type Triangles = (Vec<Corner>, Vec<[u32; 3]>);

fn v3(v: &[f32]) -> V3 {
    V3::new(f64::from(v[0]), f64::from(v[1]), f64::from(v[2]))
}

fn obj(mut bytes: &[u8]) -> std::result::Result<Triangles, String> {
    let options = tobj::LoadOptions { single_index: true, triangulate: true, ..Default::default() };
    // Materials are the scene's.
    let (models, _) =
        tobj::load_obj_buf(&mut bytes, &options, |_| Ok(Default::default())).map_err(|e| e.to_string())?;
    let (mut corners, mut triangles) = (vec![], vec![]);
    for model in models {
        let mesh = model.mesh;
        let first = corners.len() as u32;
        for (k, place) in mesh.positions.chunks_exact(3).enumerate() {
            let normal = mesh.normals.get(3 * k..3 * k + 3).map(v3);
            let uv = mesh.texcoords.get(2 * k..2 * k + 2).map(|t| [f64::from(t[0]), f64::from(t[1])]);
            corners.push(Corner { place: v3(place), normal, tangent: None, uv });
        }
        triangles.extend(mesh.indices.as_chunks::<3>().0.iter().map(|t| t.map(|k| k.saturating_add(first))));
    }
    Ok((corners, triangles))
}

fn ply(mut bytes: &[u8]) -> std::result::Result<Triangles, String> {
    let parser = Parser::<DefaultElement>::new();
    let header = parser.read_ply_header(&mut &*bytes).map_err(|e| e.to_string())?;
    if let Some(element) = header.elements.values().find(|e| e.count > bytes.len()) {
        return Err(format!("promises {} of {} in {} bytes", element.count, element.name, bytes.len()));
    }
    let ply = parser.read_ply(&mut bytes).map_err(|e| e.to_string())?;
    let elements = |name: &str| ply.payload.get(name).map_or(&[][..], |e| e.as_slice());
    let number = |e: &DefaultElement, name: &str| match e.get(name) {
        Some(Property::Double(v)) => Some(*v),
        Some(other) => other.to_f32_lossy().map(f64::from),
        None => None,
    };
    let triple = |e: &DefaultElement, names: [&str; 3]| -> Option<V3> {
        Some(V3::new(number(e, names[0])?, number(e, names[1])?, number(e, names[2])?))
    };
    let pair = |e: &DefaultElement, [a, b]: [&str; 2]| Some([number(e, a)?, number(e, b)?]);
    let mut corners = vec![];
    for e in elements("vertex") {
        let place = triple(e, ["x", "y", "z"]).ok_or("has vertices without x, y and z")?;
        let uv = pair(e, ["u", "v"]).or_else(|| pair(e, ["s", "t"])).or_else(|| pair(e, ["texture_u", "texture_v"]));
        let (normal, tangent) = (triple(e, ["nx", "ny", "nz"]), triple(e, ["tx", "ty", "tz"]));
        corners.push(Corner { place, normal, tangent, uv });
    }
    let mut triangles: Vec<[u32; 3]> = vec![];
    for e in elements("face") {
        let list = e.get("vertex_indices").or_else(|| e.get("vertex_index")).and_then(Property::to_u32_list);
        let list = list.ok_or("has faces without vertex_indices")?;
        // A fan.
        triangles.extend((2..list.len()).map(|k| [list[0], list[k - 1], list[k]]));
        if triangles.len() > MOST_TRIANGLES {
            break;
        }
    }
    Ok((corners, triangles))
}

fn gltf(bytes_of: &[u8], path: &Path) -> Result<Triangles> {
    let bad = |problem: String| Error::file(path, problem, REMEDY);
    let file = gltf::Gltf::from_slice(bytes_of).map_err(|e| bad(e.to_string()))?;
    let mut buffers: Vec<Vec<u8>> = vec![];
    for buffer in file.buffers() {
        let data = match buffer.source() {
            gltf::buffer::Source::Bin => file.blob.clone().ok_or_else(|| bad("has no binary part".into()))?,
            gltf::buffer::Source::Uri(uri) => match uri.split_once(";base64,") {
                Some((_, text)) => base64::engine::general_purpose::STANDARD
                    .decode(text)
                    .map_err(|e| bad(format!("has a buffer that is no base64: {e}")))?,
                None if inside(Path::new(uri)) => bytes(&path.with_file_name("").join(uri))?,
                None => return Err(bad(format!("has a buffer outside of its folder: {uri}"))),
            },
        };
        buffers.push(data);
    }
    for accessor in file.accessors() {
        check_accessor(&accessor, &buffers).map_err(bad)?;
    }
    let (mut corners, mut triangles) = (vec![], vec![]);
    let scene = file.default_scene().or_else(|| file.scenes().next()).ok_or_else(|| bad("has no scene".into()))?;
    let mut todo: Vec<(gltf::Node, nalgebra::Matrix4<f64>, usize)> =
        scene.nodes().map(|n| (n, nalgebra::Matrix4::identity(), 0)).collect();
    while let Some((node, above, depth)) = todo.pop() {
        if depth > 64 {
            return Err(bad("has nodes more than 64 deep".into()));
        }
        let own = node.transform().matrix();
        let matrix = above * nalgebra::Matrix4::from_fn(|r, c| f64::from(own[c][r]));
        todo.extend(node.children().map(|n| (n, matrix, depth + 1)));
        for primitive in node.mesh().iter().flat_map(|m| m.primitives().collect::<Vec<_>>()) {
            if primitive.mode() == gltf::mesh::Mode::Triangles {
                add_primitive(&primitive, &buffers, &matrix, (&mut corners, &mut triangles)).map_err(bad)?;
            }
        }
        if triangles.len() > MOST_TRIANGLES {
            break;
        }
    }
    Ok((corners, triangles))
}

/// Refuses what would be read beyond the end of a buffer.
fn check_accessor(accessor: &gltf::Accessor, buffers: &[Vec<u8>]) -> std::result::Result<(), String> {
    let Some(view) = accessor.view() else { return Err("has a sparse or an empty accessor".into()) };
    if accessor.sparse().is_some() {
        return Err("has a sparse accessor".into());
    }
    let stride = view.stride().unwrap_or(accessor.size());
    let last = accessor.count().saturating_sub(1).saturating_mul(stride);
    let end = accessor.offset().saturating_add(last).saturating_add(accessor.size());
    let there = buffers.get(view.buffer().index()).map_or(0, Vec::len);
    if end > view.length() || view.offset().saturating_add(view.length()) > there {
        return Err(format!("has accessor {} reach beyond its buffer", accessor.index()));
    }
    Ok(())
}

fn add_primitive(
    primitive: &gltf::Primitive,
    buffers: &[Vec<u8>],
    matrix: &nalgebra::Matrix4<f64>,
    (corners, triangles): (&mut Vec<Corner>, &mut Vec<[u32; 3]>),
) -> std::result::Result<(), String> {
    let reader = primitive.reader(|buffer| buffers.get(buffer.index()).map(Vec::as_slice));
    let places: Vec<[f32; 3]> = reader.read_positions().ok_or("has a primitive without positions")?.collect();
    let normals: Vec<[f32; 3]> = reader.read_normals().map(Iterator::collect).unwrap_or_default();
    let tangents: Vec<[f32; 4]> = reader.read_tangents().map(Iterator::collect).unwrap_or_default();
    let uvs: Vec<[f32; 2]> = reader.read_tex_coords(0).map(|t| t.into_f32().collect()).unwrap_or_default();
    let turn = matrix.fixed_view::<3, 3>(0, 0).into_owned();
    let upright = turn.try_inverse().map_or(turn, |i| i.transpose());
    let shift = V3::new(matrix[(0, 3)], matrix[(1, 3)], matrix[(2, 3)]);
    let first = corners.len() as u32;
    for (k, place) in places.iter().enumerate() {
        corners.push(Corner {
            place: turn * v3(place) + shift,
            normal: normals.get(k).map(|n| upright * v3(n)),
            tangent: tangents.get(k).map(|t| turn * v3(&t[..3])),
            // v runs down in glTF.
            uv: uvs.get(k).map(|t| [f64::from(t[0]), 1.0 - f64::from(t[1])]),
        });
    }
    let indices: Vec<u32> = match reader.read_indices() {
        Some(indices) => indices.into_u32().collect(),
        None => (0..places.len() as u32).collect(),
    };
    triangles.extend(indices.as_chunks::<3>().0.iter().map(|t| t.map(|k| k.saturating_add(first))));
    Ok(())
}
