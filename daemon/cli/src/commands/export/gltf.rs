//! Gratings as a quad in a binary glTF file, with `KHR_materials_anisotropy`.

use super::surface::{ALPHA_ALONG, Surface};
use serde_json::{Value, json};

/// glTF's numbers of types and targets.
const FLOAT: u32 = 5126;
const U16: u32 = 5123;
const ARRAY: u32 = 34_962;
const INDICES: u32 = 34_963;
const NEAREST: u32 = 9728;
const CLAMP: u32 = 33_071;

/// A `.glb` file of the surface: a quad in the xy plane that faces +z, in metres, around the origin.
pub fn bytes(surface: &Surface) -> Vec<u8> {
    let [x, y] = surface.size_mm.map(|side| (side / 2e3) as f32);
    let corners = [[-x, -y], [x, -y], [x, y], [-x, y]];
    // Texture coordinates begin at the upper left corner. Bitangents, normal × tangent, point up.
    let texture = [[0.0, 1.0], [1.0, 1.0], [1.0, 0.0], [0.0, 0.0_f32]];
    let floats = |values: Vec<f32>| values.iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<u8>>();
    let parts = [
        floats(corners.iter().flat_map(|[x, y]| [*x, *y, 0.0]).collect()),
        floats([[0.0, 0.0, 1.0]; 4].concat()),
        floats([[1.0, 0.0, 0.0, 1.0]; 4].concat()),
        floats(texture.concat()),
        [0_u16, 1, 2, 0, 2, 3].iter().flat_map(|i| i.to_le_bytes()).collect(),
        surface.texture.clone(),
    ];
    let (mut binary, mut views) = (vec![], vec![]);
    for (k, part) in parts.iter().enumerate() {
        let mut view = json!({"buffer": 0, "byteOffset": binary.len(), "byteLength": part.len()});
        if k < 5 {
            view["target"] = json!(if k < 4 { ARRAY } else { INDICES });
        }
        views.push(view);
        binary.extend(part);
        binary.resize(binary.len().next_multiple_of(4), 0);
    }
    let accessor =
        |view: u32, kind: &str| json!({"bufferView": view, "componentType": FLOAT, "count": 4, "type": kind});
    let mut accessors = vec![accessor(0, "VEC3"), accessor(1, "VEC3"), accessor(2, "VEC4"), accessor(3, "VEC2")];
    accessors[0]["min"] = json!([-x, -y, 0.0]);
    accessors[0]["max"] = json!([x, y, 0.0]);
    accessors.push(json!({"bufferView": 4, "componentType": U16, "count": 6, "type": "SCALAR"}));
    let mut document = scene(surface);
    document["buffers"] = json!([{"byteLength": binary.len()}]);
    document["bufferViews"] = json!(views);
    document["accessors"] = json!(accessors);
    container(&document, &binary)
}

/// All but the binary data.
fn scene(surface: &Surface) -> Value {
    let [r, g, b] = surface.reflectance;
    let anisotropy = json!({"anisotropyStrength": 1.0, "anisotropyTexture": {"index": 0}});
    json!({
        "asset": {
            "version": "2.0",
            "generator": concat!("nacre ", env!("CARGO_PKG_VERSION")),
            "extras": {"lost": surface.lost},
        },
        "extensionsUsed": ["KHR_materials_anisotropy"],
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"name": "grating", "mesh": 0}],
        "meshes": [{"primitives": [{
            "attributes": {"POSITION": 0, "NORMAL": 1, "TANGENT": 2, "TEXCOORD_0": 3},
            "indices": 4,
            "material": 0,
        }]}],
        "materials": [{
            "name": "grating",
            "pbrMetallicRoughness": {
                "baseColorFactor": [r, g, b, 1.0],
                "metallicFactor": 1.0,
                "roughnessFactor": ALPHA_ALONG.sqrt(),
            },
            "extensions": {"KHR_materials_anisotropy": anisotropy},
        }],
        "textures": [{"sampler": 0, "source": 0}],
        // Opposite vectors are one direction, and their mean is none.
        "samplers": [{"magFilter": NEAREST, "minFilter": NEAREST, "wrapS": CLAMP, "wrapT": CLAMP}],
        "images": [{"name": "anisotropy", "mimeType": "image/png", "bufferView": 5}],
    })
}

/// The container of glTF 2.0: header, then a chunk of JSON and one of binary data.
fn container(document: &Value, binary: &[u8]) -> Vec<u8> {
    let mut text = document.to_string().into_bytes();
    text.resize(text.len().next_multiple_of(4), b' ');
    let length = 12 + 8 + text.len() + 8 + binary.len();
    let mut bytes = b"glTF".to_vec();
    bytes.extend([2, length as u32].iter().flat_map(|v| v.to_le_bytes()));
    for (kind, chunk) in [(b"JSON", text.as_slice()), (b"BIN\0", binary)] {
        bytes.extend((chunk.len() as u32).to_le_bytes());
        bytes.extend(kind);
        bytes.extend(chunk);
    }
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn chunks_are_aligned_and_fill_the_file() {
        for texture in 1..9 {
            let surface = Surface {
                size_mm: [30.0, 20.0],
                texture: vec![7; texture],
                alpha_across: 0.2,
                reflectance: [0.9; 3],
                lost: vec!["Colours: none.".into()],
                warnings: vec![],
            };
            let file = bytes(&surface);
            let word = |at: usize| u32::from_le_bytes(file[at..at + 4].try_into().unwrap()) as usize;
            assert_eq!((&file[..4], word(4), word(8)), (b"glTF".as_slice(), 2, file.len()));
            let json = word(12);
            assert_eq!((json % 4, 28 + json + word(20 + json)), (0, file.len()));
            let document: Value = serde_json::from_slice(&file[20..20 + json]).unwrap();
            assert_eq!(document["asset"]["extras"]["lost"][0], "Colours: none.");
            let view = &document["bufferViews"][5];
            let at = 28 + json + view["byteOffset"].as_u64().unwrap() as usize;
            assert_eq!(&file[at..at + texture], surface.texture);
        }
    }
}
