//! Tests with glTF files as written by various programs.

use super::*;
use base64::Engine;
use serde_json::{Value, json};

/// A document with one buffer.
struct File {
    json: Value,
    data: Vec<u8>,
}

impl File {
    fn new() -> Self {
        let json = json!({
            "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
            "meshes": [{"primitives": []}], "accessors": [], "bufferViews": [],
        });
        Self { json, data: vec![] }
    }

    fn push(&mut self, key: &str, value: Value) -> usize {
        let list = self.json[key].as_array_mut().unwrap();
        list.push(value);
        list.len() - 1
    }

    fn view(&mut self, bytes: &[u8], stride: Option<usize>) -> usize {
        self.data.resize(self.data.len().next_multiple_of(4), 0);
        let mut view = json!({"buffer": 0, "byteOffset": self.data.len(), "byteLength": bytes.len()});
        if let Some(stride) = stride {
            view["byteStride"] = stride.into();
        }
        self.data.extend(bytes);
        self.push("bufferViews", view)
    }

    fn floats(&mut self, kind: &str, values: &[f32]) -> usize {
        let bytes: Vec<u8> = values.iter().flat_map(|v| v.to_le_bytes()).collect();
        let view = self.view(&bytes, None);
        let size = match kind {
            "SCALAR" => 1,
            "VEC2" => 2,
            "VEC3" => 3,
            "VEC4" => 4,
            _ => 16,
        };
        self.push(
            "accessors",
            json!({"bufferView": view, "componentType": 5126, "count": values.len() / size, "type": kind}),
        )
    }

    fn indices(&mut self, values: &[u16]) -> usize {
        let bytes: Vec<u8> = values.iter().flat_map(|v| v.to_le_bytes()).collect();
        let view = self.view(&bytes, None);
        self.push(
            "accessors",
            json!({"bufferView": view, "componentType": 5123, "count": values.len(), "type": "SCALAR"}),
        )
    }

    fn primitive(&mut self, primitive: Value) {
        self.json["meshes"][0]["primitives"].as_array_mut().unwrap().push(primitive);
    }

    /// The file with an embedded buffer.
    fn text(&self) -> String {
        let data = base64::engine::general_purpose::STANDARD.encode(&self.data);
        let uri = format!("data:application/octet-stream;base64,{data}");
        self.with(json!({"byteLength": self.data.len(), "uri": uri}))
    }

    fn with(&self, buffer: Value) -> String {
        let mut json = self.json.clone();
        json["buffers"] = json!([buffer]);
        json.to_string()
    }

    fn binary(&self) -> Vec<u8> {
        let mut json = self.with(json!({"byteLength": self.data.len()})).into_bytes();
        json.resize(json.len().next_multiple_of(4), b' ');
        let mut data = self.data.clone();
        data.resize(data.len().next_multiple_of(4), 0);
        let mut file = b"glTF\x02\0\0\0".to_vec();
        file.extend((28 + json.len() as u32 + data.len() as u32).to_le_bytes());
        for (kind, chunk) in [(b"JSON", json), (b"BIN\0", data)] {
            file.extend((chunk.len() as u32).to_le_bytes());
            file.extend(kind);
            file.extend(chunk);
        }
        file
    }

    fn read(&self) -> Raw {
        mesh("a.gltf", self.text()).unwrap()
    }
}

/// A rectangle of 6 by 2 at z = 1, as corners of a strip.
const STRIP: [f32; 12] = [0.0, 0.0, 1.0, 6.0, 0.0, 1.0, 0.0, 2.0, 1.0, 6.0, 2.0, 1.0];

#[test]
fn strips_fans_and_triangles_add_up() {
    let mut file = File::new();
    let strip = file.floats("VEC3", &STRIP);
    file.primitive(json!({"attributes": {"POSITION": strip}, "mode": 5}));
    assert_eq!(file.read().triangles, [[0, 1, 2], [2, 1, 3]]);
    let fan = file.indices(&[0, 1, 3, 2]);
    file.primitive(json!({"attributes": {"POSITION": strip}, "indices": fan, "mode": 6}));
    assert_eq!(file.read().triangles[2..], [[4, 5, 7], [4, 7, 6]]);
    let list = file.indices(&[0, 1, 2]);
    file.primitive(json!({"attributes": {"POSITION": strip}, "indices": list}));
    let mesh_of_all = file.read();
    assert!((area(&mesh_of_all) - 30.0).abs() < 1e-9);
    assert_eq!(warnings(mesh_of_all), [""; 0]);
    // Joined strips, points and lines, a material and an animation.
    let joined = file.indices(&[0, 1, 2, 2, 3, 3, 1, 2]);
    file.primitive(json!({"attributes": {"POSITION": strip}, "indices": joined, "mode": 5}));
    for mode in 0..4 {
        file.primitive(json!({"attributes": {"POSITION": strip}, "mode": mode}));
    }
    file.json["materials"] = json!([{}, {"anything": {"at": "all"}}]);
    file.json["animations"] = json!([{"channels": 7}]);
    let mesh_of_all = file.read();
    assert!((area(&mesh_of_all) - 42.0).abs() < 1e-9);
    let said = warnings(mesh_of_all).join("; ");
    for words in ["4 points", "9 lines", "2 materials", "1 animation"] {
        assert!(said.contains(words), "{said}");
    }
}

#[test]
fn only_lines_are_refused_by_name() {
    let mut file = File::new();
    let strip = file.floats("VEC3", &STRIP);
    file.primitive(json!({"attributes": {"POSITION": strip}, "mode": 1}));
    let said = refusal("a.gltf", file.text());
    assert!(said.contains("has no faces (2 lines)"), "{said}");
}

/// Integers of every type, normalised or not, with a stride.
#[test]
fn quantized_corners() {
    for (code, size, full) in [(5120, 1, 127.0), (5121, 1, 255.0), (5122, 2, 32_767.0), (5123, 2, 65_535.0)] {
        for normalized in [false, true] {
            let mut file = File::new();
            // A triangle of legs 100 and 50 in units of the integer; signed ones begin at -20.
            let shift = if code % 2 == 0 { -20 } else { 0 };
            let stride = if size == 1 { 4 } else { 8 };
            let mut bytes = vec![];
            for [x, y] in [[0, 0], [100, 0], [0, 50]] {
                let begin = bytes.len();
                for v in [x + shift, y + shift, 7_i32] {
                    bytes.extend(&v.to_le_bytes()[..size]);
                }
                bytes.resize(begin + stride, 0xee);
            }
            let view = file.view(&bytes, Some(stride));
            let places = json!({"bufferView": view, "componentType": code, "normalized": normalized, "count": 3, "type": "VEC3"});
            let places = file.push("accessors", places);
            file.primitive(json!({"attributes": {"POSITION": places}}));
            file.json["extensionsUsed"] = json!(["KHR_mesh_quantization"]);
            file.json["extensionsRequired"] = json!(["KHR_mesh_quantization"]);
            file.json["nodes"] = json!([{"mesh": 0, "scale": [2, 2, 2], "translation": [5, 0, 0]}]);
            let expected = 2500.0 * if normalized { 4.0 / (full * full) } else { 4.0 };
            let found = area(&file.read());
            assert!((found / expected - 1.0).abs() < 1e-9, "{code} {normalized}: {found}, {expected}");
        }
    }
    // The smallest signed integer is -1.
    let mut file = File::new();
    let view = file.view(&[0x80, 0x80, 0, 0, 127, 0x81, 0, 0, 127, 127, 0, 0], Some(4));
    let places = json!({"bufferView": view, "componentType": 5120, "normalized": true, "count": 3, "type": "VEC3"});
    let places = file.push("accessors", places);
    file.primitive(json!({"attributes": {"POSITION": places}}));
    assert!((area(&file.read()) - 2.0).abs() < 1e-12);
}

/// Integer texture coordinates are scaled by the transform of their material; for floats the transform belongs to the
/// material.
#[test]
fn quantized_texture_coordinates() {
    for (integers, expected) in [(true, [0.75, 1.0 - 0.5]), (false, [1000.0, 1.0 - 500.0])] {
        let mut file = File::new();
        let strip = file.floats("VEC3", &STRIP);
        let uv = if integers {
            let bytes: Vec<u8> = [0_u16, 0, 1000, 500, 0, 500, 7, 7].iter().flat_map(|v| v.to_le_bytes()).collect();
            let view = file.view(&bytes, None);
            file.push("accessors", json!({"bufferView": view, "componentType": 5123, "count": 4, "type": "VEC2"}))
        } else {
            file.floats("VEC2", &[0.0, 0.0, 1000.0, 500.0, 0.0, 500.0, 7.0, 7.0])
        };
        let transform = json!({"scale": [0.0005, 0.001], "offset": [0.25, 0]});
        file.json["materials"] = json!([
            {}, {"pbrMetallicRoughness": {"baseColorTexture": {"index": 0, "extensions": {"KHR_texture_transform": transform}}}},
        ]);
        file.primitive(json!({"attributes": {"POSITION": strip, "TEXCOORD_0": uv}, "mode": 5, "material": 1}));
        let found = file.read().corners[1].uv.unwrap();
        assert!(found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-12), "{found:?}");
    }
}

#[test]
fn sparse_accessors_replace_some_values_or_zeros() {
    for based in [true, false] {
        for (code, size) in [(5121, 1), (5123, 2), (5125, 4)] {
            let mut file = File::new();
            let base = file.floats("VEC3", &[0.0; 12]);
            let places: Vec<u8> = [1_u32, 2, 3].iter().flat_map(|v| v.to_le_bytes()[..size].to_vec()).collect();
            let places = file.view(&places, None);
            let values: Vec<u8> = STRIP[3..].iter().flat_map(|v| v.to_le_bytes()).collect();
            let values = file.view(&values, None);
            let accessor = &mut file.json["accessors"][base];
            accessor["sparse"] = json!({
                "count": 3, "indices": {"bufferView": places, "componentType": code}, "values": {"bufferView": values},
            });
            if !based {
                accessor.as_object_mut().unwrap().remove("bufferView");
            }
            file.primitive(json!({"attributes": {"POSITION": base}, "mode": 5}));
            let mesh_of_it = file.read();
            assert_eq!(mesh_of_it.corners[3].place, V3::new(6.0, 2.0, 1.0));
            assert_eq!(mesh_of_it.corners[0].place, V3::zeros());
            file.json["accessors"][base]["count"] = 3.into();
            assert!(refusal("a.gltf", file.text()).contains("sparse element 3 of 3"));
            file.json["accessors"][base]["sparse"]["count"] = 400.into();
            assert!(refusal("a.gltf", file.text()).contains("400 sparse elements of 3"));
        }
    }
}

#[test]
fn buffers_beside_the_file() {
    let mut file = File::new();
    let strip = file.floats("VEC3", &STRIP);
    file.primitive(json!({"attributes": {"POSITION": strip}, "mode": 5}));
    let folder = tempfile::tempdir().unwrap();
    let inner = folder.path().join("inner");
    std::fs::create_dir_all(inner.join("größe 2")).unwrap();
    std::fs::write(folder.path().join("secret.bin"), &file.data).unwrap();
    for name in ["a b.bin", "größe 2/100%.bin", "plain.bin", "a%20c.bin"] {
        std::fs::write(inner.join(name), &file.data).unwrap();
    }
    let path = inner.join("a.gltf");
    let read_with = |uri: &str| {
        std::fs::write(&path, file.with(json!({"byteLength": file.data.len(), "uri": uri}))).unwrap();
        read(&path)
    };
    for uri in
        ["a%20b.bin", "a b.bin", "gr%C3%B6%c3%9fe%202/100%25.bin", "größe 2/100%.bin", "./plain.bin", "a%20c.bin"]
    {
        assert!((area(&read_with(uri).unwrap()) - 12.0).abs() < 1e-9, "{uri}");
    }
    for uri in
        ["../secret.bin", "%2e%2e/secret.bin", "..%2Fsecret.bin", "/etc/passwd", "%2Fetc%2Fpasswd", "https://x/a.bin"]
    {
        let said = read_with(uri).map(drop).unwrap_err().to_string();
        assert!(said.contains("outside of its folder"), "{uri}: {said}");
    }
    let said = read_with("none%20there.bin").map(drop).unwrap_err().to_string();
    assert!(said.contains("a.gltf") && said.contains("\"none there.bin\""), "{said}");
    let short = file.with(json!({"byteLength": 4000, "uri": "plain.bin"}));
    std::fs::write(&path, short).unwrap();
    let said = read(&path).map(drop).unwrap_err().to_string();
    assert!(said.contains("48 bytes in buffer 0, which promises 4000"), "{said}");
}

#[test]
fn binary_files_and_marks() {
    let mut file = File::new();
    let strip = file.floats("VEC3", &STRIP);
    file.primitive(json!({"attributes": {"POSITION": strip}, "mode": 5}));
    let binary = file.binary();
    for (name, bytes) in
        [("a.glb", binary.clone()), ("a.gltf", binary.clone()), ("a.gltf", format!("\u{feff}{}", file.text()).into())]
    {
        assert!((area(&mesh(name, bytes).unwrap()) - 12.0).abs() < 1e-9);
    }
    assert!(refusal("a.glb", &binary[..binary.len() - 9]).contains("truncated GLB"));
    let mut old = binary;
    old[4] = 1;
    assert!(refusal("a.glb", old).contains("binary glTF 1"));
    let old = r#"{"asset": {"version": "1.0"}, "meshes": {"a": {}}}"#;
    assert!(refusal("a.gltf", old).contains("is glTF 1.0; 2.0 is read"));
    assert!(refusal("a.gltf", r#"{"asset": {}}"#).contains("asset.version is missing"));
    let said = refusal("a.gltf", "{\"asset\": {\"version\": \"2.0\"},\n\"meshes\": 7}");
    assert!(said.contains("no valid glTF") && said.contains("line 2"), "{said}");
}

#[test]
fn extensions_are_read_without_effect_or_refused() {
    let mut file = File::new();
    let strip = file.floats("VEC3", &STRIP);
    file.primitive(json!({"attributes": {"POSITION": strip}, "mode": 5}));
    file.json["extensionsRequired"] = json!(["KHR_materials_unlit", "KHR_texture_basisu", "EXT_texture_webp"]);
    assert!((area(&file.read()) - 12.0).abs() < 1e-9);
    for name in ["KHR_draco_mesh_compression", "EXT_meshopt_compression", "VENDOR_surface"] {
        file.json["extensionsRequired"] = json!([name]);
        let said = refusal("a.gltf", file.text());
        assert!(said.contains(&format!("needs the glTF extension {name}")), "{said}");
    }
    file.json["extensionsRequired"] = json!([]);
    file.json["nodes"] = json!([{"mesh": 0, "extensions": {"EXT_mesh_gpu_instancing": {"attributes": {}}}}]);
    assert!(refusal("a.gltf", file.text()).contains("EXT_mesh_gpu_instancing"));
}

#[test]
fn nodes_place_meshes() {
    let mut file = File::new();
    let strip = file.floats("VEC3", &STRIP);
    file.primitive(json!({"attributes": {"POSITION": strip}, "mode": 5}));
    file.json["nodes"] = json!([
        {"children": [1, 2], "scale": [1, 3, 1]}, {"mesh": 0},
        {"mesh": 0, "matrix": [0, 1, 0, 0, -1, 0, 0, 0, 0, 0, 1, 0, 9, 0, 0, 1]}, {"mesh": 0},
    ]);
    // Sides 6 and 6; with the rotation first, sides 2 and 18.
    assert!((area(&file.read()) - 72.0).abs() < 1e-9);
    file.json["scenes"] = json!([{"nodes": [0]}, {"nodes": [3]}]);
    assert!(warnings(file.read()).join("").contains("1 further scene"));
    file.json["scenes"] = json!([]);
    assert!(refusal("a.gltf", file.text()).contains("default scene"));
    file.json.as_object_mut().unwrap().remove("scene");
    assert!((area(&file.read()) - 84.0).abs() < 1e-9);
    file.json["nodes"][2]["children"] = json!([1]);
    assert!(refusal("a.gltf", file.text()).contains("node 1 below two others"));
    file.json["scenes"] = json!([{"nodes": [0]}]);
    file.json["nodes"] = json!([{"children": [0]}]);
    assert!(refusal("a.gltf", file.text()).contains("below two others"));
}

#[test]
fn morph_targets_and_skins_in_rest_pose() {
    let mut file = File::new();
    let strip = file.floats("VEC3", &STRIP);
    let shifts = file.floats("VEC3", &[0.0, 0.0, 0.0, 4.0, 0.0, 0.0, 0.0, 0.0, 0.0, 4.0, 0.0, 0.0]);
    file.primitive(json!({"attributes": {"POSITION": strip}, "mode": 5, "targets": [{"POSITION": shifts}]}));
    assert!((area(&file.read()) - 12.0).abs() < 1e-9);
    file.json["meshes"][0]["weights"] = json!([0.5]);
    assert!((area(&file.read()) - 16.0).abs() < 1e-9);
    file.json["nodes"] = json!([{"mesh": 0, "weights": [-0.25]}]);
    assert!((area(&file.read()) - 10.0).abs() < 1e-9);

    let mut file = File::new();
    let strip = file.floats("VEC3", &STRIP);
    // The right corners follow a joint that moves them by 2; the left ones stay.
    let joints = file.view(&[0, 0, 0, 0, 1, 0, 0, 0, 0, 0, 0, 0, 1, 0, 0, 0], None);
    let joints =
        file.push("accessors", json!({"bufferView": joints, "componentType": 5121, "count": 4, "type": "VEC4"}));
    let weights = file.floats("VEC4", &[1.0, 0.0, 0.0, 0.0].repeat(4));
    let mut bind = vec![0.0; 32];
    for k in 0..2 {
        (0..4).for_each(|c| bind[16 * k + 5 * c] = 1.0);
    }
    bind[16 + 12] = -6.0;
    let bind = file.floats("MAT4", &bind);
    file.primitive(json!({"attributes": {"POSITION": strip, "JOINTS_0": joints, "WEIGHTS_0": weights}, "mode": 5}));
    file.json["scenes"] = json!([{"nodes": [0, 1, 2]}]);
    // The node of the mesh has no effect on a skinned mesh.
    file.json["nodes"] =
        json!([{"mesh": 0, "skin": 0, "scale": [9, 9, 9]}, {"name": "root"}, {"translation": [8, 0, 0]}]);
    file.json["skins"] = json!([{"joints": [1, 2], "inverseBindMatrices": bind}]);
    let moved = file.read();
    assert!((area(&moved) - 16.0).abs() < 1e-9, "{}", area(&moved));
    assert_eq!(moved.corners[1].place, V3::new(8.0, 0.0, 1.0));
    file.json["skins"][0]["joints"] = json!([1, 7]);
    assert!(refusal("a.gltf", file.text()).contains("joint 7"));
}

#[test]
fn inconsistent_accessors_are_named() {
    let mut file = File::new();
    let strip = file.floats("VEC3", &STRIP);
    let uv = file.floats("VEC2", &[0.0; 6]);
    file.primitive(json!({"attributes": {"POSITION": strip, "TEXCOORD_0": uv}, "mode": 5}));
    assert!(refusal("a.gltf", file.text()).contains("3 elements in accessor 1 for 4 vertices"));
    let change = |key: &str, value: Value| {
        let mut json = File { json: file.json.clone(), data: file.data.clone() };
        json.json["accessors"][0][key] = value;
        refusal("a.gltf", json.text())
    };
    assert!(change("count", json!(5)).contains("beyond its buffer"));
    assert!(change("count", json!(u64::MAX)).contains("elements in accessor 0"));
    assert!(change("byteOffset", json!(u64::MAX)).contains("beyond its buffer"));
    assert!(change("componentType", json!(5130)).contains("component type 5130"));
    assert!(change("type", json!("VEC2")).contains("VEC2 in accessor 0 instead of VEC3"));
    assert!(change("bufferView", json!(9)).contains("buffer view 9"));
    file.json["meshes"][0]["primitives"][0]["attributes"]["POSITION"] = 9.into();
    assert!(refusal("a.gltf", file.text()).contains("accessor 9"));
}

#[test]
fn damaged_files_never_panic() {
    let mut file = File::new();
    let strip = file.floats("VEC3", &STRIP);
    let list = file.indices(&[0, 1, 2, 2, 1, 3]);
    file.primitive(json!({"attributes": {"POSITION": strip}, "indices": list}));
    damage("a.gltf", file.text().as_bytes(), 9);
    damage("a.glb", &file.binary(), 10);
}
