// What repeats in two directions: height fields (relief.rs) and lattices of rectangles (slits.rs). Each of its spatial frequencies is a lobe.

// Wave numbers of Norm's table, at most.
const MOST_NUMBERS: i32 = 48;
// How far a phase turns between two wave numbers of a sum, at most.
const TURN: f32 = 0.5;

// What the direction of view is divided by, times its cosine, at the wave numbers of the table.
var<private> norms: array<f32, 48>;

// Weights of four nodes, by Catmull and Rom.
fn cubic(t: f32) -> vec4<f32> {
    let s = t * t;
    let c = s * t;
    return 0.5 * vec4(2.0 * s - t - c, 2.0 - 5.0 * s + 3.0 * c, t + 4.0 * s - 3.0 * c, c - s);
}

// Looks the norm up for a direction of view: tiles of views, one for each wave number.
fn find_norms(view: vec3<f32>) {
    let side = i32(scene.detail.z);
    let across = i32(textureDimensions(norm).x) / side;
    let to = inverseSqrt((1.0 + view.z) * (1.0 + sqrt(max(view.z, 0.0))));
    let place = 0.5 * (clamp(view.xy * to, vec2(-1.0), vec2(1.0)) + 1.0) * f32(side - 1);
    let low = min(vec2<i32>(place), vec2(side - 2));
    let u = cubic(place.x - f32(low.x));
    let v = cubic(place.y - f32(low.y));
    for (var n = 0; n < i32(scene.detail.w); n++) {
        let tile = vec2(n % across, n / across) * side;
        var sum = 0.0;
        for (var k = 0; k < 4; k++) {
            let y = clamp(low.y + k - 1, 0, side - 1);
            let x = clamp(low.x + vec4(-1, 0, 1, 2), vec4(0), vec4(side - 1));
            let row = vec4(
                textureLoad(norm, tile + vec2(x.x, y), 0).x,
                textureLoad(norm, tile + vec2(x.y, y), 0).x,
                textureLoad(norm, tile + vec2(x.z, y), 0).x,
                textureLoad(norm, tile + vec2(x.w, y), 0).x,
            );
            sum += v[k] * dot(u, row);
        }
        norms[n] = sum;
    }
}

fn norm_at(cosine: f32, number: f32) -> f32 {
    let last = i32(scene.detail.w) - 1;
    let place = clamp((number - FIRST) / (LAST - FIRST), 0.0, 1.0) * f32(last);
    let k = min(i32(place), last - 1);
    let near = vec4(norms[max(k - 1, 0)], norms[k], norms[k + 1], norms[min(k + 2, last)]);
    // The albedo times cos θ; the table has it times another cosine (see GRAZING in norm.rs).
    let albedo = dot(cubic(place - f32(k)), near) / max(cosine, 2e-3);
    return select(max(albedo, cosine), max(albedo, 1e-9), scene.detail.y > 0.0);
}

// Power of a frequency of a height field for X, the phase of half its range.
fn field_power(bin: vec2<i32>, x: f32) -> f32 {
    let last = i32(textureDimensions(phases).y) - 2;
    let row = clamp(i32(x * scene.detail.x), 0, last);
    let share = clamp(x * scene.detail.x - f32(row), 0.0, 1.0);
    let reach = vec2<i32>(scene.repeat.zw);
    let side = 2 * reach + 1;
    let across = i32(textureDimensions(terms).x) / side.x;
    let at = bin + reach;
    var sum = vec2(0.0);
    // Pairs of terms: of each its real and its imaginary part.
    for (var n = 0; n < i32(scene.turn.z); n++) {
        let by = mix(textureLoad(phases, vec2(n, row), 0), textureLoad(phases, vec2(n, row + 1), 0), share);
        let pair = textureLoad(terms, at + side * vec2(n % across, n / across), 0);
        sum += by.x * pair.xy + by.y * pair.zw;
    }
    return dot(sum, sum);
}

fn sinc_square(x: f32) -> f32 {
    let y = PI * x;
    let s = select(sin(y) / y, 1.0 - y * y / 6.0, abs(y) < 1e-3);
    return s * s;
}

// Power of a frequency at a wave number; w is the sum of both cosines.
fn frequency_power(bin: vec2<i32>, number: f32, w: f32, cosine: f32) -> f32 {
    if scene.what.x == 5.0 {
        return field_power(bin, 2.0 * PI * number * w * scene.turn.w) / norm_at(cosine, number);
    }
    let share = scene.detail.xy / scene.repeat.xy * vec2<f32>(bin);
    return sinc_square(share.x) * sinc_square(share.y) * scene.detail.z;
}

// How far from a frequency its lobe is followed, in 1/µm.
fn field_margin(width: f32) -> f32 {
    return scene.sums.y * sqrt(scene.grooves.w + width * width * LAST * LAST);
}

// One frequency's lobe, summed up over the wave numbers that meet it: X, Y, Z.
fn frequency_lobe(bin: vec2<i32>, range: vec2<f32>, view: vec3<f32>, light: vec3<f32>, width: f32, lamp: i32) -> vec3<f32> {
    let t = view.xy + light.xy;
    let g = vec2<f32>(bin) / scene.repeat.xy;
    // Within the square that the processor looks at: flanks outshine what is dark beside them.
    let margin = field_margin(width);
    let safe = select(t, vec2(1e-9), abs(t) < vec2(1e-9));
    let first = (g - margin) / safe;
    let last = (g + margin) / safe;
    let low = min(first, last);
    let high = max(first, last);
    let ends = vec2(max(max(low.x, low.y), range.x), min(min(high.x, high.y), range.y));
    if ends.x >= ends.y {
        return vec3(0.0);
    }
    let w = view.z + light.z;
    var step = min(scene.lights[LIGHT_ROWS * lamp + 2].w, TURN / max(4.0 * PI * w * scene.turn.w, 1e-6));
    let deviation = nearest(t, g, light, width).y;
    if deviation > 0.0 {
        step = min(deviation * scene.sums.x, step);
    }
    let count = clamp(i32(ceil((ends.y - ends.x) / step)), 1, MOST_SAMPLES);
    let apart = (ends.y - ends.x) / f32(count);
    let cosine = half_cos(view, light);
    var sum = vec3(0.0);
    for (var k = 0; k <= count; k++) {
        let number = ends.x + apart * f32(k);
        let off = number * t - g;
        let c = covariance(light, width, number);
        let density = exp(-0.5 * product(c, off, off)) * inverseSqrt(c.x * c.y - c.z * c.z) / (2.0 * PI);
        let weight = select(apart, 0.5 * apart, k == 0 || k == count);
        let power = frequency_power(bin, number, w, view.z);
        sum += seen(lamp, number) * (density * power * number * number * reflectance(cosine, number) * weight);
    }
    return sum;
}

// BRDF times the cosine of a small light, summed up over its spectrum: X, Y, Z. Walks along the line of frequencies that its colours see.
fn field_lit(eye: vec3<f32>, towards: vec3<f32>, width: f32, lamp: i32) -> vec3<f32> {
    let axis = scene.turn.xy;
    let view = vec3(dot(axis, eye.xy), axis.x * eye.y - axis.y * eye.x, eye.z);
    let light = vec3(dot(axis, towards.xy), axis.x * towards.y - axis.y * towards.x, towards.z);
    let range = spectrum_range(lamp);
    // Frequencies as cycles of what repeats, the faster direction first.
    let steep = abs(view.x + light.x) * scene.repeat.x < abs(view.y + light.y) * scene.repeat.y;
    var t = (view.xy + light.xy) * scene.repeat.xy;
    var margin = field_margin(width) * scene.repeat.xy;
    var most = scene.repeat.zw;
    if steep {
        t = t.yx;
        margin = margin.yx;
        most = most.yx;
    }
    if scene.what.x == 5.0 {
        find_norms(view);
    }
    let first = i32(max(ceil(min(t.x * range.x, t.x * range.y) - margin.x), -most.x));
    let last = i32(min(floor(max(t.x * range.x, t.x * range.y) + margin.x), most.x));
    let slow = select(t.x, select(-1e-6, 1e-6, t.x >= 0.0), abs(t.x) < 1e-6);
    var sum = vec3(0.0);
    for (var a = first; a <= last; a++) {
        // Where the line is while it is so near.
        let ends = clamp((f32(a) + vec2(-margin.x, margin.x)) / slow, vec2(range.x), vec2(range.y));
        let low = i32(max(ceil(min(t.y * ends.x, t.y * ends.y) - margin.y), -most.y));
        let high = i32(min(floor(max(t.y * ends.x, t.y * ends.y) + margin.y), most.y));
        for (var b = low; b <= high; b++) {
            sum += frequency_lobe(select(vec2(a, b), vec2(b, a), steep), range, view, light, width, lamp);
        }
    }
    if scene.what.x != 5.0 {
        return sum * light.z;
    }
    let aligned = (1.0 + dot(view, light)) / (view.z + light.z);
    return sum * aligned * aligned;
}
