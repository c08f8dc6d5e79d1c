// Slits under small lights: the sum over them in closed form (slits.rs), times what balance makes of the nearest order.

fn sinc(x: f32) -> f32 {
    return select(sin(x) / x, 1.0 - x * x / 6.0, abs(x) < 1e-3);
}

// Light relative to the mirror direction at a spatial frequency across the slits.
fn slits_at(frequency: f32, spacing: f32) -> f32 {
    // From the nearest order, so that nothing is 0/0.
    let off = PI * (spacing * frequency - round(spacing * frequency));
    let both = sinc(PI * scene.detail.x * frequency) * sinc(scene.detail.y * off) / sinc(off);
    return both * both;
}

// The same under a light of some width, in frequencies.
fn slits_under(frequency: f32, spacing: f32, blur: f32) -> f32 {
    if blur * spacing * scene.detail.y < 0.05 {
        return slits_at(frequency, spacing);
    }
    return 0.4026 * slits_at(frequency, spacing)
        + 0.2442 * (slits_at(frequency - blur, spacing) + slits_at(frequency + blur, spacing))
        + 0.0545 * (slits_at(frequency - 2.0 * blur, spacing) + slits_at(frequency + 2.0 * blur, spacing));
}

// What balance makes of an order; below 0 where its light comes from below the horizon.
fn slits_factor(order: i32, number: f32, view: vec3<f32>, at: Groove) -> f32 {
    return balanced(order, number, view, at.across, at.period) / max(scalar_power(order, 0.0), 1e-9);
}

// BRDF of slits under a small light, summed up over its spectrum: X, Y, Z.
fn slits_lit(view: vec3<f32>, light: vec3<f32>, width: f32, lamp: i32, at: Groove) -> vec3<f32> {
    let t = view.xy + light.xy;
    let across = dot(t, at.across);
    let beside = t.y * at.across.x - t.x * at.across.y;
    let range = spectrum_range(lamp);
    let square = scene.grooves.w;
    if abs(beside) * FIRST > scene.sums.y * sqrt(square + LAST * LAST * width * width) {
        return vec3(0.0);
    }
    let sine = dot(light.xy, at.across);
    let blur = width * sqrt(max(1.0 - sine * sine, 0.0));
    let slow = max(abs(across), 1e-9);
    let step = min(
        min(0.5 / (scene.detail.y * at.period * slow), sqrt(square + FIRST * FIRST * width * width) / max(abs(beside), 1e-9)),
        scene.lights[LIGHT_ROWS * lamp + 2].w,
    );
    let low = i32(round(min(across * range.x, across * range.y) * at.period));
    let high = i32(round(max(across * range.x, across * range.y) * at.period));
    var sum = vec3(0.0);
    for (var order = low; order <= min(high, low + MOST_ORDERS); order++) {
        // Half way to the next orders.
        let middle = f32(order) / (across * at.period);
        let half = 0.5 / (slow * at.period);
        var ends = range;
        if slow * at.period > 1e-6 {
            ends = clamp(middle + vec2(-half, half), vec2(range.x), vec2(range.y));
        }
        let parts = clamp(i32(ceil((ends.y - ends.x) / PART)), 1, PARTS);
        let length = (ends.y - ends.x) / f32(parts);
        let count = clamp(i32(ceil(length / step)), 1, MOST_SAMPLES);
        let apart = length / f32(count);
        var before = slits_factor(order, ends.x, view, at);
        for (var part = 0; part < parts; part++) {
            let start = ends.x + length * f32(part);
            let after = slits_factor(order, start + length, view, at);
            for (var k = 0; k <= count; k++) {
                let nu = start + apart * f32(k);
                let share = f32(k) / f32(count);
                let factor = select(mix(before, after, share), max(before, after), min(before, after) < 0.0);
                let sigma = sqrt(square + nu * nu * width * width);
                let off = beside * nu / sigma;
                let window = exp(-0.5 * off * off) / (sqrt(2.0 * PI) * sigma);
                let weight = select(apart, 0.5 * apart, k == 0 || k == count);
                let density = slits_under(across * nu, at.period, blur * nu) * window;
                sum += seen(lamp, nu) * (density * max(factor, 0.0) * nu * nu * weight);
            }
            before = after;
        }
    }
    // Part of the surface that reflects, and what makes the sum over all frequencies 1.
    return sum * scene.detail.z * scene.detail.y * scene.detail.x;
}
