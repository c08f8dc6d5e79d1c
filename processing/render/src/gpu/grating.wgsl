// Exact orders of gratings under small lights: grating.rs and lobes.rs say why it is done so.

// More coupled directions than this are scaled by their row alone.
const MOST: i32 = 16;
// Most orders of a place that are looked at, samples of a lobe, and parts in which powers are linear.
const MOST_ORDERS: i32 = 64;
const MOST_SAMPLES: i32 = 512;
const PARTS: i32 = 16;
const PART: f32 = 0.12;

struct Groove {
    across: vec2<f32>,
    period: f32,
    // σ of the orientation; below 0 where nothing diffracts.
    sigma: f32,
}

fn groove(uv: vec2<f32>) -> Groove {
    var orientation = scene.same.x;
    var period = scene.same.y;
    var sigma = 0.0;
    if scene.same.z + scene.same.w > 0.0 {
        let place = fract(uv * scene.grooves.xy);
        let size = vec2<f32>(textureDimensions(maps));
        let at = min(vec2(place.x, 1.0 - place.y) * size, size - 1.0);
        let found = textureLoad(maps, vec2<i32>(at), 0);
        orientation = select(orientation, found.x, scene.same.z > 0.0);
        period = select(period, found.y, scene.same.w > 0.0);
        sigma = select(-1.0, found.z, found.w > 0.5);
    }
    var across = vec2(cos(orientation), sin(orientation));
    if scene.grooves.z > 0.0 {
        let middle = uv - 0.5;
        sigma = select(-1.0, sigma, length(middle) > 1e-6);
        across = normalize(middle + vec2(1e-12, 0.0));
    }
    return Groove(across, period, sigma);
}

// Power of an order in scalar theory for q = 2πν(cos θi + cos θr).
fn scalar_power(order: i32, q: f32) -> f32 {
    if abs(order) > i32(scene.relief.z) {
        return 0.0;
    }
    let place = q * scene.relief.x;
    let last = i32(textureDimensions(powers).y) - 2;
    let k = clamp(i32(place), 0, last);
    let column = order + i32(scene.relief.y);
    let low = textureLoad(powers, vec2(column, k), 0).x;
    let high = textureLoad(powers, vec2(column, k + 1), 0).x;
    return mix(low, high, clamp(place - f32(k), 0.0, 1.0));
}

// Cosine of the n-th direction that a grating couples with a direction of view; g is the step of their sines.
fn coupled_cos(n: i32, view: vec3<f32>, g: vec2<f32>) -> f32 {
    let at = view.xy + f32(n) * g;
    // Never quite grazing, where scalar theory's gain has no limit.
    return select(sqrt(max(1.0 - dot(at, at), 1e-6)), max(view.z, 1e-3), n == 0);
}

fn coupling(out: i32, into: i32, cosines: vec2<f32>, number: f32, view: vec3<f32>, g: vec2<f32>) -> f32 {
    let sum = cosines.x + cosines.y;
    let power = scalar_power(out - into, 2.0 * PI * number * sum);
    let product = cosines.x * cosines.y;
    let aligned = product - dot(view.xy + f32(out) * g, view.xy + f32(into) * g);
    return power * (1.0 + aligned) * (1.0 + aligned) / (product * sum * sum);
}

// With four directions, the first of which is `into`; none beyond the last.
fn couplings(out: i32, into: i32, last: i32, number: f32, view: vec3<f32>, g: vec2<f32>) -> vec4<f32> {
    let c = coupled_cos(out, view, g);
    let found = vec4(
        coupling(out, into, vec2(c, coupled_cos(into, view, g)), number, view, g),
        coupling(out, into + 1, vec2(c, coupled_cos(into + 1, view, g)), number, view, g),
        coupling(out, into + 2, vec2(c, coupled_cos(into + 2, view, g)), number, view, g),
        coupling(out, into + 3, vec2(c, coupled_cos(into + 3, view, g)), number, view, g),
    );
    return select(vec4(0.0), found, vec4(into, into + 1, into + 2, into + 3) <= vec4(last));
}

// Four columns at once: software that stands in for a card counts the turns of all loops and ends them after 65535.
const FOURS: i32 = 4;
var<private> matrix: array<vec4<f32>, 64>;
var<private> rows: array<f32, 16>;
var<private> columns: array<vec4<f32>, 4>;

// Factors of rows and columns that make the matrix of powers add up to 1 both ways (Sinkhorn and Knopp 1967).
fn balance(count: i32) {
    for (var k = 0; k < count; k++) {
        rows[k] = 1.0;
    }
    let rounds = i32(scene.sums.z);
    for (var round = 0; round < rounds; round++) {
        for (var n = 0; 4 * n < count; n++) {
            var sum = vec4(0.0);
            for (var k = 0; k < count; k++) {
                sum += matrix[k * FOURS + n] * rows[k];
            }
            columns[n] = 1.0 / max(sum, vec4(1e-12));
        }
        var worst = 0.0;
        for (var k = 0; k < count; k++) {
            var sum = 0.0;
            for (var n = 0; 4 * n < count; n++) {
                sum += dot(matrix[k * FOURS + n], columns[n]);
            }
            worst = max(worst, abs(rows[k] * sum - 1.0));
            rows[k] = 1.0 / max(sum, 1e-12);
        }
        if worst < scene.sums.w {
            break;
        }
    }
}

// The same where orders m and -m have the same power, so that factors of rows are those of columns: grating.rs says why in these steps.
fn balance_even(count: i32) {
    for (var k = 0; k < 4 * FOURS; k++) {
        rows[k] = 1.0;
    }
    var worst = 1.0;
    let rounds = 2 * i32(scene.sums.z);
    for (var round = 0; round < rounds && worst >= scene.sums.w; round++) {
        rows_to_columns();
        worst = 0.0;
        for (var k = 0; k < count; k++) {
            var sum = 0.0;
            for (var n = 0; 4 * n < count; n++) {
                sum += dot(columns[n], matrix[k * FOURS + n]);
            }
            sum *= rows[k];
            worst = max(worst, abs(sum - 1.0));
            let step = select(sum, sqrt(sum), round % 3 == 0);
            rows[k] /= select(1.0, step, step > 0.0);
        }
    }
    rows_to_columns();
}

fn rows_to_columns() {
    for (var n = 0; n < FOURS; n++) {
        columns[n] = vec4(rows[4 * n], rows[4 * n + 1], rows[4 * n + 2], rows[4 * n + 3]);
    }
}

// First and last of the directions that a grating couples with a direction of view; g is the step of their sines.
fn coupled(view: vec3<f32>, g: vec2<f32>) -> vec2<i32> {
    let square = dot(g, g);
    let along = dot(view.xy, g) / square;
    let reach = sqrt(max((1.0 - dot(view.xy, view.xy)) / square + along * along, 0.0));
    return vec2(min(i32(ceil(-along - reach)), 0), max(i32(floor(-along + reach)), 0));
}

// Finds the factors of all coupled directions, of which there are MOST at most.
fn balance_between(ends: vec2<i32>, number: f32, view: vec3<f32>, g: vec2<f32>) {
    let count = ends.y - ends.x + 1;
    for (var k = 0; k < count; k++) {
        for (var n = 0; 4 * n < count; n++) {
            matrix[k * FOURS + n] = couplings(k + ends.x, 4 * n + ends.x, ends.y, number, view, g);
        }
    }
    if scene.relief.w > 0.0 {
        balance_even(count);
    } else {
        balance(count);
    }
}

// Power from a coupled direction towards the view's, once factors are found.
fn balanced_power(into: i32, ends: vec2<i32>) -> f32 {
    let at = into - ends.x;
    return matrix[-ends.x * FOURS + at / 4][at % 4] * rows[-ends.x] * columns[at / 4][at % 4];
}

// Power of an order at a wave number, such that none gain or lose light; below 0 where its light comes from below the horizon.
fn balanced(order: i32, number: f32, view: vec3<f32>, across: vec2<f32>, period: f32) -> f32 {
    let g = across / (number * period);
    let ends = coupled(view, g);
    let into = -order;
    if into < ends.x || into > ends.y {
        return -1.0;
    }
    if ends.y - ends.x >= MOST {
        return one_row(into, ends, number, view, g);
    }
    balance_between(ends, number, view, g);
    return balanced_power(into, ends);
}

fn one_row(into: i32, ends: vec2<i32>, number: f32, view: vec3<f32>, g: vec2<f32>) -> f32 {
    let most = i32(scene.relief.z);
    var sum = 0.0;
    var own = 0.0;
    for (var n = max(ends.x, -most); n <= min(ends.y, most); n++) {
        let both = vec2(max(view.z, 1e-3), coupled_cos(n, view, g));
        let power = coupling(0, n, both, number, view, g);
        sum += power;
        own = select(own, power, n == into);
    }
    return own / max(sum, 1e-30);
}

// Covariance (xx, yy, xy) of a lobe's spatial frequencies at a wave number: coherence, and a light that is round across the line of sight.
fn covariance(light: vec3<f32>, width: f32, number: f32) -> vec3<f32> {
    let square = width * width * number * number;
    let sines = vec3(1.0 - light.x * light.x, 1.0 - light.y * light.y, -light.x * light.y);
    return square * sines + vec3(scene.grooves.w, scene.grooves.w, 0.0);
}

// Product of two vectors by the inverse of a covariance.
fn product(c: vec3<f32>, a: vec2<f32>, b: vec2<f32>) -> f32 {
    let det = c.x * c.y - c.z * c.z;
    return (c.y * a.x * b.x + c.x * a.y * b.y - c.z * (a.x * b.y + a.y * b.x)) / det;
}

// Wave number at which ν t is nearest to g, its standard deviation along the line (0: all are as near), and its square distance there.
fn nearest(t: vec2<f32>, g: vec2<f32>, light: vec3<f32>, width: f32) -> vec3<f32> {
    var found = vec3(0.5 * (FIRST + LAST), 0.0, 0.0);
    for (var k = 0; k < 2; k++) {
        let c = covariance(light, width, clamp(found.x, FIRST, LAST));
        let square = product(c, t, t);
        if square < 1e-9 {
            return vec3(found.x, 0.0, product(c, g, g));
        }
        let at = product(c, t, g) / square;
        let off = at * t - g;
        found = vec3(at, inverseSqrt(square), product(c, off, off));
    }
    return found;
}

// X, Y, Z per wave number of a light.
fn seen(lamp: i32, number: f32) -> vec3<f32> {
    let shine = scene.lights[LIGHT_ROWS * lamp + 1];
    let place = (number - shine.z) / shine.w;
    let last = i32(textureDimensions(spectra).x) - 2;
    let k = clamp(i32(place), 0, last);
    let low = textureLoad(spectra, vec2(k, lamp), 0).xyz;
    let high = textureLoad(spectra, vec2(k + 1, lamp), 0).xyz;
    return mix(low, high, clamp(place - f32(k), 0.0, 1.0));
}

// First and last wave number of a light.
fn spectrum_range(lamp: i32) -> vec2<f32> {
    let shine = scene.lights[LIGHT_ROWS * lamp + 1];
    return vec2(shine.z, shine.z + shine.w * f32(textureDimensions(spectra).x - 1u));
}

// Reflectance of the smooth material at a cosine and a wave number.
fn reflectance(cosine: f32, number: f32) -> f32 {
    let last = vec2<f32>(textureDimensions(mirror)) - 1.0;
    return smooth_at(mirror, vec2(cosine, (number - FIRST) / (LAST - FIRST)) * last).x;
}

// Cosine of the angle to the half vector.
fn half_cos(view: vec3<f32>, light: vec3<f32>) -> f32 {
    return sqrt(clamp(0.5 * (1.0 + dot(view, light)), 0.0, 1.0));
}

// One lobe between two wave numbers: X, Y, Z by the trapezoid rule, with powers that are linear between their parts' ends.
fn lobe(order: i32, ends: vec2<f32>, step: f32, view: vec3<f32>, light: vec3<f32>, width: f32, lamp: i32, at: Groove) -> vec3<f32> {
    let t = view.xy + light.xy;
    let g = at.across * (f32(order) / at.period);
    let cosine = half_cos(view, light);
    let parts = clamp(i32(ceil((ends.y - ends.x) / PART)), 1, PARTS);
    let length = (ends.y - ends.x) / f32(parts);
    let count = clamp(i32(ceil(length / step)), 1, MOST_SAMPLES);
    let apart = length / f32(count);
    var sum = vec3(0.0);
    var low = balanced(order, ends.x, view, at.across, at.period);
    for (var part = 0; part < parts; part++) {
        let start = ends.x + length * f32(part);
        let high = balanced(order, start + length, view, at.across, at.period);
        for (var k = 0; k <= count; k++) {
            let number = start + apart * f32(k);
            let power = select(mix(low, high, f32(k) / f32(count)), max(low, high), min(low, high) < 0.0);
            let off = number * t - g;
            let c = covariance(light, width, number);
            let density = exp(-0.5 * product(c, off, off)) * inverseSqrt(c.x * c.y - c.z * c.z) / (2.0 * PI);
            let weight = select(apart, 0.5 * apart, k == 0 || k == count);
            let value = density * max(power, 0.0) * number * number * reflectance(cosine, number);
            sum += seen(lamp, number) * (value * weight);
        }
        low = high;
    }
    return sum;
}

// BRDF of a grating under a small light, summed up over its spectrum: X, Y, Z.
fn grating_lit(view: vec3<f32>, light: vec3<f32>, width: f32, lamp: i32, at: Groove) -> vec3<f32> {
    let fine = scene.lights[LIGHT_ROWS * lamp + 2].w;
    let range = spectrum_range(lamp);
    let t = view.xy + light.xy;
    let reach = scene.sums.y;
    let margin = (reach + 1.0) * at.period * (sqrt(scene.grooves.w) + range.y * width);
    let along = dot(t, at.across) * at.period * range;
    let most = scene.relief.z;
    let low = i32(max(ceil(min(along.x, along.y) - margin), -most));
    let high = i32(min(floor(max(along.x, along.y) + margin), most));
    var sum = vec3(0.0);
    for (var order = low; order <= min(high, low + MOST_ORDERS); order++) {
        let near = nearest(t, at.across * (f32(order) / at.period), light, width);
        if near.z > reach * reach {
            continue;
        }
        var ends = range;
        var step = fine;
        if near.y > 0.0 {
            ends = vec2(max(near.x - reach * near.y, range.x), min(near.x + reach * near.y, range.y));
            step = min(near.y * scene.sums.x, fine);
        }
        if ends.x < ends.y {
            sum += lobe(order, ends, step, view, light, width, lamp, at);
        }
    }
    return sum;
}
