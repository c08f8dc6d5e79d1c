//! Memory bandwidth of the fit's kernels, compared with a plain copy.
//!
//! Bytes per pixel: with all N frames in memory, each is read once and five maps are written, 4 N + 20. The streaming
//! fit reads two frames, the pivot and four sums, and writes the sums again: 8 + 4 + 32. `copy` counts bytes read and
//! written. No count includes the read of a cache line before it is overwritten, which a plain copy can avoid.
//!
//! `cargo bench -p nacre-processing --bench fit` measures wall time. On a busy machine, the example `speed` is more
//! reliable, because it measures CPU time.

#![allow(clippy::expect_used)]

use divan::counter::BytesCount;
use nacre_processing::polarimetry::{Design, Fit, StokesMaps, fit_stack};
use rayon::prelude::*;
use rayon::{ThreadPool, ThreadPoolBuilder};
use std::f64::consts::PI;

const WIDTH: usize = 4096;
const HEIGHT: usize = 3072;
const PIXELS: usize = WIDTH * HEIGHT;
const FRAMES: usize = 13;
const THREADS: [usize; 2] = [1, 2];

fn main() {
    divan::main();
}

fn pool(threads: usize) -> ThreadPool {
    ThreadPoolBuilder::new().num_threads(threads).build().expect("threads")
}

fn angles() -> Vec<f64> {
    (0..FRAMES).map(|k| PI * k as f64 / FRAMES as f64).collect()
}

fn frames(count: usize) -> Vec<Vec<f32>> {
    let value = |k: usize, i: usize| 1000.0 + ((7 * i + 13 * k) % 251) as f32;
    (0..count).map(|k| (0..PIXELS).map(|i| value(k, i)).collect()).collect()
}

/// Reference bandwidth: a copy of plain slices with as many bytes as the frames.
#[divan::bench(args = THREADS, sample_count = 20)]
fn copy(bencher: divan::Bencher, threads: usize) {
    let (pool, source) = (pool(threads), frames(FRAMES));
    let mut target = source.clone();
    bencher.counter(BytesCount::new(8 * FRAMES * PIXELS)).bench_local(|| {
        pool.install(|| {
            // Whole frames, long enough for stores that bypass the cache.
            target.par_iter_mut().zip(&source).for_each(|(t, s)| t.copy_from_slice(s));
        });
    });
}

/// Fits frames in memory: S0, S1, S2, residual and correlation of each pixel.
#[divan::bench(args = THREADS, sample_count = 20)]
fn stack_of_13_frames(bencher: divan::Bencher, threads: usize) {
    let (pool, frames, design) = (pool(threads), frames(FRAMES), Design::new(&angles()).expect("good angles"));
    let slices: Vec<&[f32]> = frames.iter().map(Vec::as_slice).collect();
    let mut maps = StokesMaps::default();
    fit_stack(&slices, WIDTH, &design, &mut maps);
    bencher
        .counter(BytesCount::new((4 * FRAMES + 20) * PIXELS))
        .bench_local(|| pool.install(|| fit_stack(&slices, WIDTH, &design, &mut maps)));
}

/// Adds two frames to the sums of the streaming fit.
#[divan::bench(args = THREADS, sample_count = 20)]
fn stream_two_frames(bencher: divan::Bencher, threads: usize) {
    let (pool, frames) = (pool(threads), frames(2));
    let mut fit = Fit::new(WIDTH, HEIGHT);
    let row = |k: usize, y: usize, row: &mut [f32], _: &mut [u8]| row.copy_from_slice(&frames[k][y * WIDTH..][..WIDTH]);
    fit.add_several(&[0.0, 0.1], row);
    bencher.counter(BytesCount::new(44 * PIXELS)).bench_local(|| pool.install(|| fit.add_several(&[0.2, 0.3], row)));
}

/// Converts the sums of the streaming fit to maps in place: 20 bytes per pixel read and written, plus flags.
#[divan::bench(args = THREADS, sample_count = 5)]
fn solve(bencher: divan::Bencher, threads: usize) {
    let angles = [0.0, 0.8, 1.6, 2.4];
    let (pool, design) = (pool(threads), Design::new(&angles).expect("good angles"));
    bencher
        .with_inputs(|| {
            let mut fit = Fit::new(WIDTH, HEIGHT);
            angles.iter().for_each(|a| fit.add(*a, |y, row, _| row.fill(y as f32 + *a as f32)));
            fit
        })
        .counter(BytesCount::new(41 * PIXELS))
        .bench_local_values(|fit| pool.install(|| fit.solve(&design)));
}
