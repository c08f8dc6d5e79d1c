//! OpenEXR files, as photographs and as each map format of the program.
#![no_main]

use libfuzzer_sys::fuzz_target;
use nacre_brdf::height::{self, Scale};
use nacre_image::{read_exr, read_exr_channel};
use nacre_lut::foil::Distribution;
use nacre_maps::Maps;
use nacre_render::environment::{Environment, Table};
use nacre_render::read_picture;

fuzz_target!(|bytes: &[u8]| {
    let path = nacre_fuzz::file("map.exr", &[b"\x76\x2f\x31\x01", bytes].concat());
    nacre_fuzz::photograph(&path);
    if let Ok(map) = read_exr(&path)
        && let Some(name) = map.channels.keys().next()
    {
        let one = read_exr_channel(&path, name).expect("a map's channel can be read by itself");
        assert!(one.is_some());
    }
    let _ = Environment::read(&path, None);
    let _ = Table::read(&path);
    let _ = Distribution::read(&path);
    let _ = height::read(&path, &Scale::default());
    let _ = Maps::read(&path);
    let _ = read_picture(&path);
});
