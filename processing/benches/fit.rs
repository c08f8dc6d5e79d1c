//! The streaming fit's kernel against its floor.
//!
//! Per pixel and frame it reads the frame (4 bytes) and five sums and writes four of them: 40 bytes. `copy` moves the same
//! bytes with plain slice copies on the same threads, so their ratio is the share of the memory bandwidth reached.

#![allow(clippy::expect_used)]

use divan::counter::BytesCount;
use nacre_processing::polarimetry::{Design, Fit};
use rayon::prelude::*;

const WIDTH: usize = 4096;
const HEIGHT: usize = 3072;
const BYTES: usize = 40 * WIDTH * HEIGHT;

fn main() {
    divan::main();
}

#[divan::bench(sample_count = 20)]
fn fold_one_frame_of_12_megapixels(bencher: divan::Bencher) {
    let frame: Vec<f32> = (0..WIDTH * HEIGHT).map(|i| (i % 251) as f32).collect();
    let mut fit = Fit::new(WIDTH, HEIGHT);
    let mut angle = 0.0;
    bencher.counter(BytesCount::new(BYTES)).bench_local(|| {
        angle += 0.1;
        fit.add(angle, |y, row, _| row.copy_from_slice(&frame[y * WIDTH..][..WIDTH]));
    });
}

#[divan::bench(sample_count = 20)]
fn copy_the_same_bytes(bencher: divan::Bencher) {
    let source = vec![1.0_f32; BYTES / 8];
    let mut target = vec![0.0_f32; BYTES / 8];
    bencher.counter(BytesCount::new(BYTES)).bench_local(|| {
        target.par_chunks_mut(WIDTH).zip(source.par_chunks(WIDTH)).for_each(|(t, s)| t.copy_from_slice(s));
    });
}

#[divan::bench(sample_count = 5)]
fn solve_12_megapixels(bencher: divan::Bencher) {
    let angles = [0.0, 0.8, 1.6, 2.4];
    let design = Design::new(&angles).expect("four good angles");
    bencher
        .with_inputs(|| {
            let mut fit = Fit::new(WIDTH, HEIGHT);
            angles.iter().for_each(|a| fit.add(*a, |y, row, _| row.fill(y as f32 + *a as f32)));
            fit
        })
        .bench_local_values(|fit| fit.solve(&design));
}
