// Three corners for any picture.

@vertex
fn corner(@builtin(vertex_index) k: u32) -> @builtin(position) vec4<f32> {
    // One triangle that covers everything.
    return vec4(select(-1.0, 3.0, k == 1u), select(-1.0, 3.0, k == 2u), 0.0, 1.0);
}
