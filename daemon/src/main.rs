//! `nacre`.
fn main() {}
