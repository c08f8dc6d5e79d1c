// Height fields under light from everywhere. What a direction of light adds is a sum over frequencies near to it, each a Gaussian lobe. Samples
// are pairs of a direction and one of these frequencies, drawn in three ways that are weighted by the balance heuristic (Veach and Guibas 1995).

// Wave numbers of a sample, and tables by which frequencies are drawn: see repeating.rs.
const HEIGHTS_NUMBERS: i32 = 8;
const COURSES: i32 = 8;
const COURSES_ACROSS: i32 = 3;

// Error function to 1.5e-7 (Abramowitz and Stegun 7.1.26).
fn erf(x: f32) -> f32 {
    let t = 1.0 / (1.0 + 0.3275911 * abs(x));
    let series = ((((1.061405429 * t - 1.453152027) * t + 1.421413741) * t - 0.284496736) * t + 0.254829592) * t;
    return sign(x) * (1.0 - series * exp(-x * x));
}

// Two normal numbers of two from 0 to 1 (Box and Muller).
fn normal(u: vec2<f32>) -> vec2<f32> {
    return sqrt(-2.0 * log(max(u.x, 1e-12))) * vec2(cos(2.0 * PI * u.y), sin(2.0 * PI * u.y));
}

// How often a place, in cycles of what repeats, that is moved by normal numbers of standard deviation `s` is rounded to a frequency.
fn rounded_to(bin: vec2<i32>, at: vec2<f32>, s: vec2<f32>) -> f32 {
    let low = (vec2<f32>(bin) - 0.5 - at) / (1.41421356 * s);
    let high = low + 1.0 / (1.41421356 * s);
    return 0.25 * (erf(high.x) - erf(low.x)) * (erf(high.y) - erf(low.y));
}

// Upper left corner of the table for a direction of view and a wave number: a surface that is seen flat is nearly a mirror.
fn course(cosine: f32, number: f32) -> vec2<i32> {
    let k = clamp(i32(cosine * number / LAST * f32(COURSES)), 0, COURSES - 1);
    return vec2(k % COURSES_ACROSS, k / COURSES_ACROSS) * vec2<i32>(scene.relief.xy);
}

// A frequency for two numbers from 0 to 1, about as often as it has power; each cell of the table has its share, and another one the rest.
fn drawn_frequency(tile: vec2<i32>, u: vec2<f32>) -> vec2<i32> {
    let side = vec2<i32>(scene.relief.xy);
    let place = u * vec2<f32>(side);
    var at = min(vec2<i32>(place), side - 1);
    var within = fract(place);
    let draw = textureLoad(under_top, tile + at, 0);
    if within.x < draw.x {
        within.x /= draw.x;
    } else {
        within.x = (within.x - draw.x) / (1.0 - draw.x);
        at = vec2<i32>(draw.yz);
    }
    let fine = i32(scene.relief.z);
    return fine * at + min(vec2<i32>(within * f32(fine)), vec2(fine - 1)) - vec2<i32>(scene.repeat.zw);
}

// How often drawn_frequency draws it.
fn drawn_share(tile: vec2<i32>, bin: vec2<i32>) -> f32 {
    let cell = (bin + vec2<i32>(scene.repeat.zw)) / i32(scene.relief.z);
    return textureLoad(under_top, tile + cell, 0).w / (scene.relief.z * scene.relief.z);
}

// Part of the directions that are drawn near to the horizon, where flat views see most; and their cosine, whose density per solid angle is as
// 1 / (cos θi + cos θr)².
fn horizon_share(cosine: f32) -> f32 {
    return 0.5 * (1.0 - cosine);
}

fn horizon_height(cosine: f32, u: f32) -> f32 {
    let z = max(cosine, 1e-6);
    return clamp(1.0 / (1.0 / z - u / (z * (1.0 + z))) - z, 0.0, 1.0);
}

fn horizon_density(cosine: f32, height: f32) -> f32 {
    let z = max(cosine, 1e-6);
    return z * (1.0 + z) / (2.0 * PI * (height + z) * (height + z));
}

// Light of the sky that a height field sends towards a direction of view, X, Y, Z.
fn heights_under(eye: vec3<f32>, hit: Hit, u: vec4<f32>) -> vec3<f32> {
    let axis = scene.turn.xy;
    let view = vec3(dot(axis, eye.xy), axis.x * eye.y - axis.y * eye.x, eye.z);
    let across = axis.x * hit.across + axis.y * hit.along;
    let along = axis.x * hit.along - axis.y * hit.across;
    let reach = vec2<i32>(scene.repeat.zw);
    let s = sqrt(scene.relief.w) * scene.repeat.xy;
    let rim = horizon_share(view.z);
    let step = (LAST - FIRST) / f32(HEIGHTS_NUMBERS);
    // Digits that nothing else looks at.
    let shift = fract(4096.0 * u.z);
    find_norms(view);
    var sum = vec3(0.0);
    for (var k = 0; k < HEIGHTS_NUMBERS; k++) {
        let number = FIRST + step * (f32(k) + shift);
        let tile = course(view.z, number);
        // Other numbers for each (Roberts' R5 sequence).
        let r = fract(u + f32(k) * vec4(0.88127146, 0.77663938, 0.68443212, 0.60317050));
        let other = vec2(r.w, fract(4096.0 * r.w));
        for (var way = 0; way < 2; way++) {
            var light = vec3(0.0);
            var bin = reach + 1;
            if way == 0 {
                let towards = sky_drawn(r.xyz);
                light = vec3(dot(across, towards), dot(along, towards), dot(hit.up, towards));
            } else if r.z < rim {
                light.z = horizon_height(view.z, r.x);
                light = vec3(sqrt(1.0 - light.z * light.z) * vec2(cos(2.0 * PI * r.y), sin(2.0 * PI * r.y)), light.z);
            } else {
                bin = drawn_frequency(tile, r.xy);
                let blur = s * normal(vec2((r.z - rim) / (1.0 - rim), r.w));
                let sent = (vec2<f32>(bin) + blur) / (scene.repeat.xy * number) - view.xy;
                light = vec3(sent, sqrt(max(1.0 - dot(sent, sent), 0.0)));
            }
            // Where light comes from, in cycles of what repeats.
            let at = (light.xy + view.xy) * scene.repeat.xy * number;
            if way == 0 || r.z < rim {
                bin = vec2<i32>(round(at + s * normal(other)));
            }
            if light.z <= 0.0 || any(abs(bin) > reach) {
                continue;
            }
            let towards = across * light.x + along * light.y + hit.up * light.z;
            let off = (at - vec2<f32>(bin)) / s;
            let lobe = exp(-0.5 * dot(off, off)) / (2.0 * PI * scene.relief.w);
            let near = rounded_to(bin, at, s) * (sky_density(towards) + rim * horizon_density(view.z, light.z));
            let density = near + (1.0 - rim) * drawn_share(tile, bin) * lobe * number * number * light.z;
            if density > 0.0 && !shaded(hit, towards, 1e30) {
                let w = view.z + light.z;
                let gain = (1.0 + dot(view, light)) / w;
                let power = frequency_power(bin, number, w, view.z) * lobe * number * number;
                let value = power * gain * gain * reflectance(half_cos(view, light), number) * step / density;
                sum += sky_seen(sky_at(towards), number) * value;
            }
        }
    }
    return sum;
}
