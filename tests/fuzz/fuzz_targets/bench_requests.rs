//! Requests to the virtual bench, as received by its socket: one JSON text per line.
#![no_main]

use libfuzzer_sys::fuzz_target;
use nacre_base::progress::Silent;
use nacre_sim::socket::answer_all;
use nacre_sim::{Bench, BenchConfig, SharedBench};

const BENCH: &str = "camera = { width = 8, height = 6 }";

fuzz_target!(|bytes: &[u8]| {
    let config = BenchConfig::from_toml(BENCH).expect("the bench above can be read");
    let bench = SharedBench::new(Bench::new(&config, &Silent).expect("and built"));
    let mut answers = vec![];
    answer_all(&bench, bytes, &mut answers);
});
