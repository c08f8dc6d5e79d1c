//! Registration of 13 photographs of 12 Mpixel: collecting the windows, finding the shifts, resampling a frame.
//!
//! Resampling is the only step that touches every pixel of every frame; `copy` is its lower bound.

#![allow(clippy::expect_used)]

use divan::counter::ItemsCount;
use nacre_processing::image::registration::{Registrar, Registration, Resampler};
use rayon::prelude::*;

const WIDTH: usize = 4096;
const HEIGHT: usize = 3072;
const FRAMES: usize = 13;

fn main() {
    divan::main();
}

fn angle(k: usize) -> f64 {
    std::f64::consts::PI * k as f64 / FRAMES as f64
}

/// Soft-edged patches of many orientations, shifted by up to one pixel as by a wedge, with slight noise.
fn frame(k: usize) -> Vec<f32> {
    let (psi, mut plane) = (angle(k), vec![0.0_f32; WIDTH * HEIGHT]);
    let hash = |i: u64| {
        let i = i.wrapping_mul(0x9e37_79b9_7f4a_7c15);
        ((i ^ i >> 29).wrapping_mul(0xbf58_476d_1ce4_e5b9) >> 40) as f64 / f64::from(1 << 24)
    };
    plane.par_chunks_mut(WIDTH).enumerate().for_each(|(y, row)| {
        for (x, v) in row.iter_mut().enumerate() {
            let (u, w) = ((x as f64 - psi.cos()) / 40.0, (y as f64 + psi.sin()) / 40.0);
            let soft = |t: f64| ((t - t.floor() - 0.5) * 20.0).tanh() * 0.5 + t.floor();
            let patch = hash((soft(u).round() as i64 * 7919 + soft(w).round() as i64) as u64);
            let edge = (soft(u) - soft(u).round()).abs() + (soft(w) - soft(w).round()).abs();
            let light = 0.3 + 0.2 * patch + 0.05 * (2.0 * psi - 6.3 * patch).cos() - 0.1 * edge;
            *v = (light + 0.002 * (hash((k * WIDTH * HEIGHT + y * WIDTH + x) as u64) - 0.5)) as f32;
        }
    });
    plane
}

fn rows(plane: &[f32]) -> impl Fn(usize, usize, &mut [f32], &mut [u8]) + Sync + '_ {
    move |y, left, values, _| values.copy_from_slice(&plane[y * WIDTH + left..][..values.len()])
}

#[divan::bench(sample_count = 5)]
fn take_in_the_first_frame(bencher: divan::Bencher) {
    let plane = frame(0);
    bencher.counter(ItemsCount::new(WIDTH * HEIGHT)).bench_local(|| Registrar::new(WIDTH, HEIGHT).add(rows(&plane)));
}

#[divan::bench(sample_count = 5)]
fn take_in_another_frame(bencher: divan::Bencher) {
    let plane = frame(0);
    let mut registrar = Registrar::new(WIDTH, HEIGHT);
    registrar.add(rows(&plane));
    bencher.bench_local(|| registrar.add(rows(&plane)));
}

#[divan::bench(sample_count = 5)]
fn find_13_shifts(bencher: divan::Bencher) {
    let mut registrar = Registrar::new(WIDTH, HEIGHT);
    (0..FRAMES).for_each(|k| registrar.add(rows(&frame(k))));
    let angles: Vec<f64> = (0..FRAMES).map(angle).collect();
    bencher.bench_local(|| {
        let Registration::Told(shifts) = registrar.polarized(&angles) else { unreachable!("textured frames") };
        shifts
    });
}

#[divan::bench(sample_count = 10)]
fn move_a_frame_back(bencher: divan::Bencher) {
    let (source, resampler) = (vec![1.0_f32; WIDTH * HEIGHT], Resampler::new([0.4, -1.3], WIDTH, HEIGHT));
    let mut target = vec![0.0_f32; WIDTH * HEIGHT];
    bencher.counter(ItemsCount::new(WIDTH * HEIGHT)).bench_local(|| {
        let each = target.par_chunks_mut(WIDTH).enumerate();
        each.for_each_init(
            || vec![0; WIDTH],
            |bad, (y, row)| resampler.row(y, |y, v, b| rows(&source)(y, 0, v, b), row, bad),
        );
    });
}

#[divan::bench(sample_count = 10)]
fn copy_a_frame(bencher: divan::Bencher) {
    let source = vec![1.0_f32; WIDTH * HEIGHT];
    let mut target = vec![0.0_f32; WIDTH * HEIGHT];
    bencher.counter(ItemsCount::new(WIDTH * HEIGHT)).bench_local(|| {
        target.par_chunks_mut(WIDTH).zip(source.par_chunks(WIDTH)).for_each(|(t, s)| t.copy_from_slice(s));
    });
}
