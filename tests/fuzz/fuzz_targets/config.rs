//! Configurations of the service and of the virtual bench, and geometries; the first byte selects one.
#![no_main]

use libfuzzer_sys::fuzz_target;
use nacre_service::config::Config;
use nacre_sim::{BenchConfig, describe};

fuzz_target!(|text: &str| {
    let Some((first, rest)) = text.split_at_checked(1) else { return };
    match first.as_bytes()[0] % 3 {
        0 => _ = Config::read(Some(&nacre_fuzz::file("nacre.toml", rest.as_bytes()))).map(|c| c.check_access()),
        1 => _ = BenchConfig::from_toml(rest).map(|bench| describe(&bench)),
        _ => _ = nacre_optics::geometry::parse(rest).map(|geometry| geometry.check()),
    }
});
