//! OBJ, PLY and glTF files, as shapes of a scene; the first byte selects the extension.
#![no_main]

use libfuzzer_sys::fuzz_target;
use nacre_base::progress::Silent;
use nacre_render::Scene;
use nacre_render::gpu::Prepared;
use std::sync::OnceLock;

const ENDINGS: [&str; 4] = ["obj", "ply", "gltf", "glb"];

const SCENE: &str = r#"
camera = { position = [0.0, 0.0, 300.0], target = [0.0, 0.0, 0.0], fov_deg = 20.0, width = 8, height = 8 }
shape = [{ type = "mesh", file = "FILE", material = "m" }]
light = [{ type = "point", position = [0, 100, 280], sigma_mm = 3 }]
material.m.base = { albedo = [0.5, 0.5, 0.5], roughness = 0.3 }
"#;

fn scene(ending: &str) -> Scene {
    Scene::parse(&SCENE.replace("FILE", &format!("mesh.{ending}"))).expect("the scene above can be read")
}

fuzz_target!(|bytes: &[u8]| {
    static SCENES: OnceLock<[Scene; 4]> = OnceLock::new();
    let Some((choice, bytes)) = bytes.split_first() else { return };
    let choice = usize::from(*choice) % ENDINGS.len();
    nacre_fuzz::file(&format!("mesh.{}", ENDINGS[choice]), bytes);
    let scene = &SCENES.get_or_init(|| ENDINGS.map(scene))[choice];
    let _ = Prepared::new(scene, nacre_fuzz::folder(), 0.05, 64, &Silent);
});
