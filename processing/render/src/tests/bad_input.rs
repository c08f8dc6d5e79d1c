//! Tests of invalid input.

use super::*;

#[test]
fn invalid_values_are_named() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path();
    let write = |name: &str, text: &str| std::fs::write(path.join(name), text).unwrap();
    write("flat.obj", "v 0 0 0\nv 1 1 1\nv 2 2 2\nf 1 2 3\n");
    write("bare.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n");
    write("wrong.obj", "v 0 0 0\nf 1 2 9\n");
    write("nan.obj", "v nan 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n");
    write("huge.ply", "ply\nformat ascii 1.0\nelement vertex 4000000000\nproperty float x\nend_header\n");
    write("short.gltf", &gltf().replace("\"count\":4,\"type\":\"VEC3\"", "\"count\":400,\"type\":\"VEC3\""));
    write("lost.gltf", &gltf().replace("\"POSITION\":0", "\"POSITION\":4294967295"));
    write("text.glb", "hello");
    write_exr(&path.join("nan.exr"), 2, 2, &["R", "G", "B"], &[], &|_, _, row| row.fill(f32::NAN)).unwrap();
    write_exr(&path.join("down.exr"), 2, 2, &["R", "G", "B"], &[], &|_, _, row| row.fill(-0.5)).unwrap();
    let plane = "[[shape]]\ntype = \"plane\"\nsize = [9, 9]\nmaterial = \"a\"\n";
    let mesh = |file: &str| format!("[[shape]]\ntype = \"mesh\"\nfile = \"{file}\"\nmaterial = \"a\"\n{FOIL}");
    let top = |text: &str| format!("{plane}[material.a.diffraction]\n{text}\n");
    let cases = [
        (format!("colour = 1\n{STAGE}{plane}{FOIL}"), "colour"),
        (format!("{STAGE}{plane}{FOIL}").replace("sigma_mm", "sigma"), "sigma"),
        (format!("{STAGE}{plane}{FOIL}").replace("fov_deg = 30", "fov_deg = nan"), "camera.fov_deg"),
        (format!("{STAGE}{plane}{FOIL}").replace("width = 32", "width = 10000000"), "10000000"),
        (format!("{STAGE}{plane}{FOIL}").replace("size = [9, 9]", "size = [9, -9]"), "shape[0].size"),
        (format!("{STAGE}{plane}{FOIL}").replace("[60, 90, 150]", "[60, inf, 150]"), "light[0].position"),
        (format!("{STAGE}{plane}"), "shape[0].material"),
        (STAGE.to_owned(), "shape"),
        (format!("{STAGE}{plane}{FOIL}").replace("period_um = 1.6\n", ""), "period_um"),
        (format!("{STAGE}{plane}{FOIL}").replace("depth_um = 0.15", "depth_um = -1"), "depth_um"),
        (format!("{STAGE}{plane}{FOIL}").replace("coverage = 0.5", "coverage = 7"), "coverage"),
        (format!("{STAGE}{plane}{FOIL}").replace("[0.1, 0.2, 0.3]", "\"none.png\""), "none.png"),
        (format!("{STAGE}{plane}{FOIL}").replace("[0.1, 0.2, 0.3]", "\"nan.exr\""), "column 0, row 0"),
        (format!("{STAGE}{plane}{FOIL}normals = \"down.exr\"\n"), "down.exr"),
        (format!("{STAGE}{}", mesh("flat.obj")), "none with an area"),
        (format!("{STAGE}{}", mesh("bare.obj")), "tangents"),
        (format!("{STAGE}{}", mesh("wrong.obj")), "wrong.obj"),
        (format!("{STAGE}{}", mesh("nan.obj")), "nan.obj"),
        (format!("{STAGE}{}", mesh("huge.ply")), "4000000000"),
        (format!("{STAGE}{}", mesh("short.gltf")), "beyond its buffer"),
        (format!("{STAGE}{}", mesh("lost.gltf")), "names accessor 4294967295, which is not there"),
        (format!("{STAGE}{}", mesh("text.glb")), "text.glb"),
        (format!("{STAGE}{}", mesh("none.obj")), "none.obj"),
        (format!("{STAGE}{}", mesh("none.stl")), "none.stl"),
        (format!("{STAGE}{}", top("type = \"table\"\nfile = \"nan.exr\"")), "nan.exr"),
        (format!("{STAGE}{}", top("type = \"multislit\"\nwidth_um = 9")), "slits"),
        (format!("{STAGE}{}", top("type = \"grating\"\nrelief = { depth_um = 0.1 }\nmaps = \"nan.exr\"")), "nan.exr"),
        (format!("{STAGE}{}", top("type = \"unknown\"")), "unknown"),
        (format!("{STAGE}{plane}{FOIL}[[light]]\ntype = \"environment\"\nfile = \"nan.exr\"\n"), "nan.exr"),
        (format!("{STAGE}{plane}{FOIL}[[light]]\ntype = \"environment\"\n"), "light[1]"),
    ];
    for (text, word) in cases {
        let file = path.join("scene.toml");
        std::fs::write(&file, &text).unwrap();
        let outcome = Scene::read(&file).and_then(|scene| render(&scene, path, &settings(4, 0.1), &Silent).map(drop));
        match outcome {
            Err(nacre_base::Error::Input { .. }) => {
                let said = outcome.unwrap_err().to_string();
                assert!(said.contains(word), "{word}: {said}\n{text}");
            }
            other => panic!("{word}: {other:?}\n{text}"),
        }
    }
}

/// A table may come from an untrusted source: its illuminant name must not be opened as a file.
#[test]
fn the_light_of_a_table_is_no_path() {
    let dir = tempfile::tempdir().unwrap();
    let secret = dir.path().join("secret.csv");
    std::fs::write(&secret, "400,1\n700,1\nsecret words\n").unwrap();
    let table = |white: Option<&str>| {
        let text = |v: &str| Attribute::Text(v.into());
        let mut attributes = vec![("extent", text("1")), ("illuminant", text(secret.to_str().unwrap()))];
        attributes.extend(white.map(|w| ("white", text(w))));
        write_exr(&dir.path().join("lut.exr"), 32, 32, &["X", "Y", "Z"], &attributes, &|c, _, row| {
            row.fill([1.1, 1.0, 0.4][c]);
        })
        .unwrap();
        let material = "[material.a.diffraction]\ntype = \"table\"\nfile = \"lut.exr\"\nlossless = true\n";
        let scene = Scene::parse(&plane(0.0, 0.0, &format!("{material}{SKY}"))).unwrap();
        render(&scene, dir.path(), &settings(256, 0.01), &Silent)
    };
    for white in [None, Some("1 0 1"), Some("1 1"), Some("nan 1 1"), Some("words")] {
        let said = table(white).map(drop).unwrap_err().to_string();
        assert!(
            said.contains("lut.exr") && said.contains("white under it") && !said.contains("secret words"),
            "{said}"
        );
    }
    // White under the table's illuminant is gray under the sky's.
    let found = mean(&table(Some("1.1 1 0.4")).unwrap().0);
    assert!(found.iter().all(|v| (v - 1.0).abs() < 0.03), "{found:?}");
}
