//! Tests with PLY files as written by various programs.

use super::*;

const PLACES: [[f32; 3]; 5] = [[0.0, 0.0, 1.0], [2.0, 0.0, 1.0], [2.0, 5.0, 1.0], [0.0, 5.0, 1.0], [1.0, 1.0, 1.0]];

fn header(format: &str, elements: &str) -> String {
    let vertex = "element vertex 5\nproperty float x\nproperty float y\nproperty float z\n";
    format!("ply\nformat {format} 1.0\ncomment words: any\nobj_info 7\n{vertex}{elements}end_header\n")
}

fn text_places() -> String {
    PLACES.iter().map(|[x, y, z]| format!("{x} {y} {z}\n")).collect()
}

/// The same file as text and as binary of both byte orders: a list of 32-bit integers with an 8-bit length per element.
fn all_encodings(element: &str, kind: &str, lists: &[&[i32]]) -> Vec<Vec<u8>> {
    let elements = format!("element {element} {}\nproperty list uchar {kind} vertex_indices\n", lists.len());
    let mut text = header("ascii", &elements) + &text_places();
    for list in lists {
        let words: Vec<String> = list.iter().map(i32::to_string).collect();
        text += &format!("{} {}\n", list.len(), words.join(" "));
    }
    let mut binary =
        [header("binary_little_endian", &elements), header("binary_big_endian", &elements)].map(String::into_bytes);
    for (big, file) in binary.iter_mut().enumerate() {
        for v in PLACES.as_flattened() {
            file.extend(if big == 1 { v.to_be_bytes() } else { v.to_le_bytes() });
        }
        for list in lists {
            file.push(list.len() as u8);
            list.iter().for_each(|v| file.extend(if big == 1 { v.to_be_bytes() } else { v.to_le_bytes() }));
        }
    }
    let [little, big] = binary;
    vec![text.replace('\n', "\r\n").into_bytes(), text.into_bytes(), little, big]
}

#[test]
fn faces_in_all_encodings() {
    // Two concave quadrilaterals, whose fans would cover more, two triangles, and a rectangle.
    for lists in
        [vec![[0, 1, 2, 3].as_slice()], vec![&[0, 1, 2], &[0, 2, 3]], vec![&[4, 2, 3, 0, 1]], vec![&[2, 3, 0, 4]]]
    {
        let expected: f64 = lists.iter().map(|list| polygon(list)).sum();
        for file in all_encodings("face", "int", &lists) {
            let mesh = mesh("a.ply", file).unwrap();
            assert!((area(&mesh) - expected).abs() < 1e-9, "{} for {expected}", area(&mesh));
        }
    }
}

fn polygon(list: &[i32]) -> f64 {
    let at = |k: usize| PLACES[list[k % list.len()] as usize].map(f64::from);
    let cross = |k: usize| at(k)[0] * at(k + 1)[1] - at(k)[1] * at(k + 1)[0];
    0.5 * (0..list.len()).map(cross).sum::<f64>().abs()
}

#[test]
fn strips_in_all_encodings() {
    // Two strips in one list; the second has the opposite orientation.
    for file in all_encodings("tristrips", "int", &[&[0, 1, 3, 2, -1, 3, 2, 0]]) {
        let mesh = mesh("a.ply", file).unwrap();
        assert_eq!(mesh.triangles, [[0, 1, 3], [3, 1, 2], [3, 2, 0]]);
        assert!((area(&mesh) - 15.0).abs() < 1e-9);
    }
    // Repeated corners join parts.
    for file in all_encodings("tristrips", "int", &[&[0, 1, 3, 3, 1, 1, 2, 3, -1]]) {
        let mesh = mesh("a.ply", file).unwrap();
        assert!((area(&mesh) - 10.0).abs() < 1e-9, "{:?}", mesh.triangles);
        assert_eq!(warnings(mesh), [""; 0]);
    }
    // Unsigned lists end strips with their largest number.
    let text = "ply\nformat ascii 1.0\nelement vertex 3\nproperty double x\nproperty double y\nproperty double z\n\
                element tristrips 1\nproperty list uint uint vertex_index\nend_header\n0 0 0 4 0 0 0 4 0\n4 0 1 2 4294967295";
    assert!((area(&mesh("a.ply", text).unwrap()) - 8.0).abs() < 1e-12);
    for file in all_encodings("tristrips", "int", &[&[0, 1, -2]]) {
        assert!(refusal("a.ply", file).contains("vertex -2"));
    }
}

#[test]
fn other_elements_are_counted() {
    let text = "\u{feff}ply\nformat ascii 1.0\nelement camera 1\nproperty float fov\nproperty list uchar int views\nelement face 1\n\
                property uchar red\nproperty list uchar uint vertex_index\nproperty list uchar float texcoord\nelement vertex 3\n\
                property uchar red\nproperty double z\nproperty short y\nproperty float x\nelement edge 2\nproperty int vertex1\n\
                property int vertex2\nend_header\n0.5 2 7 8\n255 3 0 1 2 6 0 0 .5 0 0 1e0\n9 1 0 0\n9 1 0 4\n9 1 6 0\n0 1\n1 2\n";
    let mesh = mesh("a.ply", text).unwrap();
    assert!((area(&mesh) - 12.0).abs() < 1e-12);
    let corner = mesh.corners[mesh.triangles[0][1] as usize];
    assert_eq!((corner.place, corner.uv), (V3::new(4.0, 0.0, 1.0), Some([0.5, 0.0])));
    let said = warnings(mesh).join("; ");
    assert!(said.contains("2 lines") && said.contains("1 element of kind \"camera\""), "{said}");
}

/// Each element of a text file has a line; surplus values on it are skipped.
#[test]
fn lines_may_have_surplus_values() {
    let face = "element face 2\nproperty list uchar int vertex_indices\nproperty uchar red\n";
    let text = header("ascii", face) + &text_places().replacen('\n', " 255 255\n", 1);
    let mesh = mesh("a.ply", text + "3 0 1 2 7\n3 0 2 3 9 1 1 1\n").unwrap();
    assert!((area(&mesh) - 10.0).abs() < 1e-9);
    assert_eq!(warnings(mesh), ["left out: 2 lines with surplus values"]);
}

#[test]
fn point_clouds_and_damaged_files_are_distinguished() {
    let said = refusal("a.ply", header("ascii", "") + &text_places());
    assert!(said.contains("has no faces (5 points)"), "{said}");
    let face = "element face 1\nproperty list uchar int corners\n";
    let said = refusal("a.ply", header("ascii", face) + &text_places() + "3 0 1 2\n");
    assert!(said.contains("without vertex_indices"), "{said}");
    let face = "element face 1\nproperty list uchar int vertex_indices\n";
    let said = refusal("a.ply", header("ascii", face) + &text_places() + "3 0 1 x\n");
    assert!(said.contains("line 17: \"x\" is no number"), "{said}");
    let said = refusal("a.ply", header("ascii", face) + &text_places() + "3 0 1 5\n");
    assert!(said.contains("vertex 5 (counted from 0) of 5"), "{said}");
    let said = refusal("a.ply", header("ascii", face) + &text_places() + "3 0 1\n");
    assert!(said.contains("ends too early"), "{said}");
    let said = refusal("a.ply", header("ascii", face).replace("float x", "half x") + &text_places());
    assert!(said.contains("line 6: unknown type \"half\""), "{said}");
    assert!(refusal("a.ply", header("ascii 2", "").replace("ascii", "utf8")).contains("unknown format"));
    assert!(refusal("a.ply", "ply\nformat ascii 1.0\nelement vertex 3\n").contains("within its header"));
    assert!(refusal("a.ply", "solid\n").contains("does not begin"));
    let mut binary = all_encodings("face", "int", &[&[0, 1, 2, 3]]).remove(2);
    binary.truncate(binary.len() - 2);
    assert!(refusal("a.ply", binary).contains("ends too early"));
}

#[test]
fn damaged_files_never_panic() {
    for (seed, file) in all_encodings("face", "int", &[&[0, 1, 2, 3], &[4, 2, 3, 0, 1]]).iter().enumerate() {
        damage("a.ply", file, seed as u64 + 5);
    }
    for (seed, file) in all_encodings("tristrips", "int", &[&[0, 1, 3, 2, -1, 3, 2, 0]]).iter().enumerate() {
        damage("a.ply", file, seed as u64 + 55);
    }
}
