//! Tests with meshes as written by other programs; shared files and areas.

mod gltf;
mod obj;
mod ply;
mod polygon;

use super::read;
use crate::shape::mesh::{Mesh, Raw};
use crate::vector::V3;

/// Reads a file with these bytes.
fn mesh(name: &str, bytes: impl AsRef<[u8]>) -> nacre_base::Result<Raw> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(name);
    std::fs::write(&path, bytes).unwrap();
    read(&path)
}

fn refusal(name: &str, bytes: impl AsRef<[u8]>) -> String {
    let words = mesh(name, bytes).map(drop).unwrap_err().to_string();
    assert!(words.contains(name), "{words}");
    words
}

/// Area of each triangle.
fn areas(mesh: &Raw) -> Vec<f64> {
    let area = |t: &[u32; 3]| {
        let [a, b, c] = t.map(|k| mesh.corners[k as usize].place);
        0.5 * (b - a).cross(&(c - a)).norm()
    };
    mesh.triangles.iter().map(area).collect()
}

fn area(mesh: &Raw) -> f64 {
    areas(mesh).iter().sum()
}

/// Whether a point of the plane z = 0 lies within any triangle.
fn covers(mesh: &Raw, x: f64, y: f64) -> bool {
    let p = V3::new(x, y, 0.0);
    mesh.triangles.iter().any(|t| {
        let [a, b, c] = t.map(|k| mesh.corners[k as usize].place);
        let side = |p: V3, q: V3, r: V3| (q - p).cross(&(r - p)).z;
        let sides = [side(a, b, p), side(b, c, p), side(c, a, p)];
        sides.iter().all(|s| *s >= 0.0) || sides.iter().all(|s| *s <= 0.0)
    })
}

fn warnings(mesh: Raw) -> Vec<String> {
    let finished: Mesh = mesh.finished().unwrap();
    finished.left_out.warnings()
}

/// Ten thousand damaged copies with `NACRE_FUZZ_ROUNDS=10000`; none may panic, and every mesh that is read is
/// consistent.
fn damage(name: &str, bytes: &[u8], seed: u64) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(name);
    let rounds = std::env::var("NACRE_FUZZ_ROUNDS").ok().and_then(|n| n.parse().ok()).unwrap_or(300);
    let mut state = seed;
    let mut dice = || {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        state as usize
    };
    for _ in 0..rounds {
        let mut copy = bytes.to_vec();
        for _ in 0..=dice() % 4 {
            let at = dice() % copy.len();
            match dice() % 4 {
                0 => copy[at] = 0xff,
                1 => copy[at] = b'0' + (dice() % 10) as u8,
                2 => copy.truncate(at.max(1)),
                _ => copy[at] = dice() as u8,
            }
        }
        std::fs::write(&path, &copy).unwrap();
        if let Ok(mesh) = read(&path) {
            assert!(mesh.triangles.iter().flatten().all(|k| (*k as usize) < mesh.corners.len()));
            _ = mesh.finished();
        } else {
            let words = read(&path).map(drop).unwrap_err().to_string();
            assert!(!words.contains("makes its decoder fail"), "{words}");
        }
    }
}
