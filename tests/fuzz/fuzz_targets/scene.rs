//! Scenes with materials, lights and shapes, rendered at small size. The folder holds a mesh, a height field and an
//! environment.
#![no_main]

use libfuzzer_sys::fuzz_target;
use nacre_base::progress::Silent;
use nacre_render::gpu::Prepared;
use nacre_render::{Options, Scene, Settings, check_folder, render};

fuzz_target!(|text: &str| {
    nacre_fuzz::file("mesh.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n");
    nacre_fuzz::file("height.txt", b"0 0.1\n0.1 0\n");
    nacre_fuzz::file("sky.hdr", b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 1 +X 2\n\x80\x80\x80\x80\x40\x40\x40\x80");
    nacre_fuzz::file("scene.toml", text.as_bytes());
    let _ = check_folder(nacre_fuzz::folder(), &Options::default());
    let Ok(mut scene) = Scene::parse(text) else { return };
    // Larger pictures take longer without executing other code.
    (scene.camera.width, scene.camera.height) = (scene.camera.width.min(6), scene.camera.height.min(4));
    let _ = Prepared::new(&scene, nacre_fuzz::folder(), 0.05, 64, &Silent);
    let settings = Settings { samples: 1, max_error: 0.5, ..Settings::default() };
    let _ = render(&scene, nacre_fuzz::folder(), &settings, &Silent);
});
