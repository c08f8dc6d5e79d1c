//! Tests with OBJ files as written by various programs.

use super::*;

/// A square of side 3 at z = 2, with text that may surround its statements.
const SQUARE: &str = "v 0 0 2\nv 3 0 2\nv 3 3 2\nv 0 3 2\n";

fn square(more: &str) -> Raw {
    let mesh = mesh("a.obj", format!("{SQUARE}{more}")).unwrap_or_else(|e| panic!("{more}: {e}"));
    assert!((area(&mesh) - 9.0).abs() < 1e-12, "{}: {more}", area(&mesh));
    mesh
}

#[test]
fn lines_may_go_on_and_hold_comments() {
    let faces = [
        "f 1 2 3 4",
        "f 1 2 \\\n3 4\n",
        "f \\\n1\\\n2\\\n3\\\n4\n",
        "f 1 2 \\\r\n 3 4\r\n",
        "f 1 2 \\ \n 3 4\n",
        "f 1 2 3 4 # a square\n",
        "f 1 2 3 4#a square\n",
        "# C:\\models\\\nf 1 2 3 4\n",
        "mtllib C:\\models\\\nf 1 2 3 4\n",
        "  f   1\t2 3 4  \n\n\n",
        "f 1 2 3 4 \\",
        "o a\ng b c\ns off\ns 1\nmg 1 0.5\nbevel on\nlod 3\nf 1 2 3 4\n",
        "unknown words\nf 1 2 3 4\n",
    ];
    for face in faces {
        square(face);
    }
    let old = SQUARE.replace('\n', "\r") + "f 1 2 3 4\r";
    assert!((area(&mesh("a.obj", old).unwrap()) - 9.0).abs() < 1e-12);
    let two_lines = "v 0 0 \\\n 2\nv 3 0 2\nv 3 3 2\nv 0 3 2\nf 1 2 3 4\n";
    assert!((area(&mesh("a.obj", two_lines).unwrap()) - 9.0).abs() < 1e-12);
}

#[test]
fn encodings_of_text() {
    let text = format!("{SQUARE}f 1 2 3 4\n");
    let wide: Vec<u16> = text.encode_utf16().collect();
    let little = [vec![0xff, 0xfe], wide.iter().flat_map(|w| w.to_le_bytes()).collect()].concat();
    let big = [vec![0xfe, 0xff], wide.iter().flat_map(|w| w.to_be_bytes()).collect()].concat();
    let latin = [b"# Gr\xfc\xdfe\n".as_slice(), text.as_bytes()].concat();
    for bytes in [format!("\u{feff}{text}").into_bytes(), little, big, latin] {
        assert!((area(&mesh("A.OBJ", bytes).unwrap()) - 9.0).abs() < 1e-12);
    }
}

#[test]
fn numbers_count_from_either_end() {
    square("f -4 -3 -2 -1\n");
    square("f 1 2 -2 -1\n");
    // Vertices may follow the faces that refer to them, except for negative indices.
    let early = "f 1 2 3 4\nv 0 0 2\nv 3 0 2\nv 3 3 2\nv 0 3 2\n";
    assert!((area(&mesh("a.obj", early).unwrap()) - 9.0).abs() < 1e-12);
    assert!(refusal("a.obj", format!("f -1 -2 -3\n{SQUARE}")).contains("line 1"));
    for (bad, word) in [
        ("f 1 2 9", "vertex 9 of 4"),
        ("f 0 1 2", "begin with 1"),
        ("f 1 2 -5", "before the first of 4"),
        ("f 1 2 x", "no whole number"),
        ("f 1 2 3.0", "no whole number"),
        ("f 1/1/1/1 2 3", "VERTEX/TEXTURE/NORMAL"),
        ("f /1 /2 /3", "VERTEX/TEXTURE/NORMAL"),
        ("f 4294967296 1 2", "vertex"),
        ("f 99999999999999999999 1 2", "no whole number"),
        ("v 1,5 2 3\nf 1 2 3", "\"1,5\" is no number"),
        ("v 1 2\nf 1 2 3", "2 numbers where 3"),
        ("v inf 0 0\nf 1 2 3", "no number"),
    ] {
        let said = refusal("a.obj", format!("{SQUARE}{bad}\n"));
        assert!(said.contains(word) && said.contains("line 5"), "{said}");
    }
}

#[test]
fn corners_have_texture_coordinates_and_normals() {
    let more = "vt 0\nvt 1 0\nvt 1 1 0.5\nvt 0 1\nvn 0 0 -1\n";
    let whole = square(&format!("{more}f 1/1/1 2/2/1 3/3/1 4/4/1\n"));
    assert_eq!(whole.corners[2].uv, Some([1.0, 1.0]));
    assert_eq!(whole.corners[0].normal, Some(V3::new(0.0, 0.0, -1.0)));
    assert_eq!(square(&format!("{more}f 1/-4/-1 2/-3/-1 3/-2/-1 4/-1/-1\n")).corners[3].uv, Some([0.0, 1.0]));
    assert_eq!(square(&format!("{more}f 1//1 2//1 3//1 4//1\n")).corners[3].uv, None);
    assert_eq!(square(&format!("{more}f 1/1/ 2/2/ 3/3/ 4/4/\n")).corners[1].normal, None);
    // Missing texture coordinates and normals do not affect surfaces.
    let said = warnings(square("vt 0 0\nf 1/1/7 2/1/7 3/2/7 4/1/7\n")).join("");
    assert!(said.contains("4 references to a missing normal, 1 reference to a missing texture coordinate"), "{said}");
    // Weights and colours after the position are ignored; corners are shared between faces.
    let coloured = "v 0 0 2 1 0 0\nv 3 0 2 1\nv 3 3 2 0 0 0 1\nv 0 3 2\nf 1 2 3\nf 1 3 4\n";
    let mesh = mesh("a.obj", coloured).unwrap();
    assert_eq!((mesh.corners.len(), area(&mesh)), (4, 9.0));
}

#[test]
fn materials_without_names_and_everything_left_out() {
    square("usemtl\nf 1 2 3 4\n");
    square("usemtl   \r\nf 1 2 3 4\n");
    square("mtllib\nusemtl \nf 1 2 3 4\n");
    let more = "usemtl steel #2\nf 1 2 3\nusemtl foil\nf 1 3 4\nusemtl steel #2\nl 1 2\nl 3 4\np 1 2 3\nf 1 2\n";
    let said = warnings(square(more)).join("; ");
    for words in
        ["2 lines", "3 points", "1 face of two corners", "2 materials (materials are the scene's)", "left out: "]
    {
        assert!(said.contains(words), "{said}");
    }
    assert_eq!(warnings(square("f 1 2 3 4\n")), [""; 0]);
    let said = refusal("a.obj", format!("{SQUARE}l 1 2 3 4\ncurv 0 1 1 2\n"));
    assert!(said.contains("has no faces (1 curve, 1 line)"), "{said}");
    let said = refusal("a.obj", "any words at all\n");
    assert!(said.contains("has no faces"), "{said}");
}

#[test]
fn damaged_files_never_panic() {
    let text =
        format!("{SQUARE}vt 0 1\nvn 0 0 1\nusemtl a\nf 1/1/1 2/1/1 \\\n3/1/1 4/1/1\nf -1//-1 -2//-1 -3//-1\nl 1 2\n");
    damage("a.obj", text.as_bytes(), 77);
}
