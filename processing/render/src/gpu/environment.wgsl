// Light from everywhere: gratings and slits as sums over orders and wavelengths in their exact directions, lattices by orders drawn by chance; tables
// and bases are looked up over directions of view where the sample is flat, and else drawn by chance.

// Pixel of a column and a row that may lie beyond the edges: columns wrap, rows go on beyond the pole.
fn sky_pixel(at: vec2<i32>, size: vec2<i32>) -> vec3<f32> {
    var x = at.x;
    var y = at.y;
    if y < 0 || y >= size.y {
        x += size.x / 2;
        y = clamp(select(2 * size.y - 1 - y, -1 - y, y < 0), 0, size.y - 1);
    }
    return textureLoad(sky, vec2((x + 2 * size.x) % size.x, y), 0).xyz;
}

// Pixels of the sky; in the texture, as many rows follow by which directions are drawn.
fn sky_size() -> vec2<i32> {
    return vec2<i32>(textureDimensions(sky)) / vec2(1, 2);
}

// Radiance from a direction of the scene, linear sRGB.
fn sky_at(towards: vec3<f32>) -> vec3<f32> {
    let d = vec3(dot(scene.sky_x.xyz, towards), dot(scene.sky_y.xyz, towards), dot(scene.sky_z.xyz, towards));
    let size = sky_size();
    let across = length(d.xy);
    // No angle has no tangent at the poles.
    let azimuth = atan2(d.y, select(d.x, 1e-6, across < 1e-6));
    let place = vec2(0.5 - azimuth / (2.0 * PI), atan2(across, d.z) / PI) * vec2<f32>(size) - 0.5;
    let low = vec2<i32>(floor(place));
    let t = place - floor(place);
    let top = mix(sky_pixel(low, size), sky_pixel(low + vec2(1, 0), size), t.x);
    let bottom = mix(sky_pixel(low + vec2(0, 1), size), sky_pixel(low + vec2(1, 1), size), t.x);
    return mix(top, bottom, t.y);
}

// X, Y, Z per wave number of a colour of the sky.
fn sky_seen(rgb: vec3<f32>, number: f32) -> vec3<f32> {
    let last = f32(textureDimensions(sky_colors).x) - 1.0;
    let x = (number - FIRST) / (LAST - FIRST) * last;
    let red = smooth_at(sky_colors, vec2(x, 0.0)).xyz;
    let green = smooth_at(sky_colors, vec2(x, 1.0)).xyz;
    let blue = smooth_at(sky_colors, vec2(x, 2.0)).xyz;
    return rgb.r * red + rgb.g * green + rgb.b * blue;
}

// Four numbers from 0 to 1 of a sample, to 24 bits: even over samples (Roberts' R4 sequence), another start for each pixel (PCG hash).
fn chance(pixel: vec2<f32>, sample: f32) -> vec4<f32> {
    var state = u32(pixel.x) + 65536u * u32(pixel.y);
    var start = vec4(0u);
    for (var k = 0; k < 4; k++) {
        state = state * 747796405u + 2891336453u;
        let word = ((state >> ((state >> 28u) + 4u)) ^ state) * 277803737u;
        start[k] = (word >> 22u) ^ word;
    }
    let turns = start + u32(sample) * vec4(3679390609u, 3152041523u, 2700274806u, 2313257605u);
    return vec4<f32>(turns >> vec4(8u)) / 16777216.0;
}

// Light of the sky that a grating sends towards a direction of view, X, Y, Z; u moves the wave numbers and blurs the lobes.
fn grating_under(view: vec3<f32>, hit: Hit, at: Groove, u: vec4<f32>) -> vec3<f32> {
    // The first order moves by a pixel of the sky at most, over four samples together.
    let pixel = PI / f32(sky_size().y);
    let apart = max(min(pixel * at.period * FIRST * FIRST, scene.sky_z.w), (LAST - FIRST) / 96.0);
    let count = max(i32(ceil((LAST - FIRST) / (4.0 * apart))), 12);
    let step = (LAST - FIRST) / f32(count);
    let radius = sqrt(-2.0 * scene.grooves.w * log(max(u.y, 1e-12)));
    let offset = radius * vec2(cos(2.0 * PI * u.z), sin(2.0 * PI * u.z));
    var sum = vec3(0.0);
    for (var k = 0; k < count; k++) {
        let number = FIRST + step * (f32(k) + u.x);
        let g = at.across / (number * at.period);
        let ends = coupled(view, g);
        let few = ends.y - ends.x < MOST;
        if few {
            balance_between(ends, number, view, g);
        }
        for (var n = ends.x; n <= ends.y; n++) {
            var power = 0.0;
            if few {
                power = balanced_power(n, ends);
            } else {
                power = one_row(n, ends, number, view, g);
            }
            if power > 1e-6 {
                let exact = -(view.xy + f32(n) * g);
                let moved = exact + offset / number;
                // No lobe reaches below the horizon.
                let s = select(exact, moved, dot(moved, moved) < 1.0);
                let light = vec3(s, sqrt(max(1.0 - dot(s, s), 0.0)));
                let towards = hit.across * light.x + hit.along * light.y + hit.up * light.z;
                if !shaded(hit, towards, 1e30) {
                    sum += sky_seen(sky_at(towards), number) * (power * step * reflectance(half_cos(view, light), number));
                }
            }
        }
    }
    return sum;
}

// A texture over the sines of view.
fn over_view(texture: texture_2d<f32>, view: vec3<f32>) -> vec3<f32> {
    let size = vec2<f32>(textureDimensions(texture));
    return smooth_at(texture, 0.5 * (view.xy + 1.0) * size - 0.5).xyz;
}

// A direction of the scene for three numbers from 0 to 1, as often as it is bright: each pixel has its share, and another one that has more
// than its share (Walker 1977).
fn sky_drawn(u: vec3<f32>) -> vec3<f32> {
    let size = sky_size();
    let place = u.xy * vec2<f32>(size);
    var at = min(vec2<i32>(place), size - 1);
    let draw = textureLoad(sky, at + vec2(0, size.y), 0);
    if u.z >= draw.x {
        at = vec2<i32>(draw.yz);
    }
    let within = fract(place);
    let edges = cos(PI * (f32(at.y) + vec2(0.0, 1.0)) / f32(size.y));
    let z = mix(edges.x, edges.y, within.y);
    let azimuth = 2.0 * PI * (0.5 - (f32(at.x) + within.x) / f32(size.x));
    let flat = sqrt(max(1.0 - z * z, 0.0)) * vec2(cos(azimuth), sin(azimuth));
    return scene.sky_x.xyz * flat.x + scene.sky_y.xyz * flat.y + scene.sky_z.xyz * z;
}

// Density of sky_drawn per solid angle.
fn sky_density(towards: vec3<f32>) -> f32 {
    let d = vec3(dot(scene.sky_x.xyz, towards), dot(scene.sky_y.xyz, towards), dot(scene.sky_z.xyz, towards));
    let size = sky_size();
    let across = length(d.xy);
    let azimuth = atan2(d.y, select(d.x, 1e-6, across < 1e-6));
    let place = vec2(0.5 - azimuth / (2.0 * PI), atan2(across, d.z) / PI) * vec2<f32>(size);
    return textureLoad(sky, clamp(vec2<i32>(place), vec2(0), size - 1), 0).w;
}

// The base beside and through what covers a part of it, where the sample is flat: the base itself, and as many rows more of what is seen through.
fn base_under(view: vec3<f32>, covered: f32) -> vec3<f32> {
    let size = vec2<f32>(textureDimensions(under_base));
    let last = size.x - 1.0;
    let at = clamp(0.5 * (view.xy + 1.0) * size.x - 0.5, vec2(0.0), vec2(last));
    var seen = (1.0 - covered) * smooth_at(under_base, at);
    if scene.specular.w > 0.0 {
        seen += covered * smooth_at(under_base, vec2(at.x, at.y + size.x));
    }
    return seen.xyz;
}

// The base by two directions, one as the sky is bright and one as the base reflects (balance heuristic; Veach and Guibas 1995).
fn rough_under(view: vec3<f32>, hit: Hit, covered: f32, u: vec3<f32>) -> vec3<f32> {
    let own = rough_drawn(view, u);
    var sum = vec3(0.0);
    for (var k = 0; k < 2; k++) {
        let towards = select(sky_drawn(u), hit.across * own.x + hit.along * own.y + hit.up * own.z, k == 1);
        let light = vec3(dot(hit.across, towards), dot(hit.along, towards), dot(hit.up, towards));
        if light.z > 0.0 && !shaded(hit, towards, 1e30) {
            let density = sky_density(towards) + rough_density(light, view);
            sum += below(covered, view, light) * rough_lit(view, light) * sky_at(towards) / density;
        }
    }
    return sum;
}

// A direction of light for three numbers from 0 to 1, as often as the table is bright at its half vector; below the horizon there is none. Where the
// sample is not flat, `under_top` holds what cells of the table are drawn by (see under.rs).
fn table_drawn(view: vec3<f32>, u: vec3<f32>) -> vec3<f32> {
    let size = vec2<i32>(textureDimensions(under_top));
    let place = u.xy * vec2<f32>(size);
    var at = min(vec2<i32>(place), size - 1);
    let draw = textureLoad(under_top, at, 0);
    if u.z >= draw.x {
        at = vec2<i32>(draw.yz);
    }
    let h = (2.0 * (vec2<f32>(at) + fract(place)) / vec2<f32>(size) - 1.0) * scene.table.x;
    let s = h - view.xy;
    return vec3(s, select(-1.0, sqrt(max(1.0 - dot(s, s), 0.0)), dot(s, s) < 1.0));
}

// Density of table_drawn per solid angle.
fn table_density(light: vec3<f32>, view: vec3<f32>) -> f32 {
    let size = vec2<f32>(textureDimensions(under_top));
    let place = 0.5 * ((light.xy + view.xy) / scene.table.x + 1.0) * size;
    if any(place < vec2(0.0)) || any(place >= size) {
        return 0.0;
    }
    return textureLoad(under_top, vec2<i32>(place), 0).w * light.z;
}

// A table by two directions, one as the sky is bright and one as the table is, weighted as those of the base.
fn table_under(view: vec3<f32>, hit: Hit, u: vec3<f32>) -> vec3<f32> {
    let own = table_drawn(view, u);
    var sum = vec3(0.0);
    for (var k = 0; k < 2; k++) {
        let towards = select(sky_drawn(u), hit.across * own.x + hit.along * own.y + hit.up * own.z, k == 1);
        let light = vec3(dot(hit.across, towards), dot(hit.along, towards), dot(hit.up, towards));
        if light.z > 0.0 && (k == 0 || own.z > 0.0) && !shaded(hit, towards, 1e30) {
            sum += table_lit(view, light) * sky_at(towards) / (sky_density(towards) + table_density(light, view));
        }
    }
    return sum;
}

// An order of a lattice along one of its axes, as often as it has power: `powers` has running sums.
fn drawn_order(axis: i32, u: f32) -> i32 {
    let last = i32(textureDimensions(powers).x) - 1;
    let wanted = u * textureLoad(powers, vec2(last, axis), 0).x;
    var low = 0;
    var high = last;
    while low < high {
        let middle = (low + high) / 2;
        if textureLoad(powers, vec2(middle, axis), 0).x <= wanted {
            low = middle + 1;
        } else {
            high = middle;
        }
    }
    return low - last / 2;
}

// Light of the sky that a lattice sends towards a direction of view, X, Y, Z: one order for each of some wave numbers (slits.rs).
fn lattice_under(view: vec3<f32>, hit: Hit, u: vec4<f32>) -> vec3<f32> {
    let cosine = scene.turn.x;
    let sine = scene.turn.y;
    let own = vec2(cosine * view.x + sine * view.y, cosine * view.y - sine * view.x);
    let step = (LAST - FIRST) / 16.0;
    // The digits that orders do not look at.
    let shift = fract(256.0 * u.w);
    var sum = vec3(0.0);
    for (var k = 0; k < 16; k++) {
        let number = FIRST + step * (f32(k) + shift);
        // Other numbers for each (Roberts' R5 sequence).
        let r = fract(u + f32(k) * vec4(0.88127146, 0.77663938, 0.68443212, 0.60317050));
        let order = vec2(f32(drawn_order(0, r.x)), f32(drawn_order(1, r.y)));
        let blur = sqrt(-2.0 * scene.grooves.w * log(max(r.z, 1e-12))) * vec2(cos(2.0 * PI * r.w), sin(2.0 * PI * r.w));
        let sent = (order / scene.repeat.xy + blur) / number - own;
        // What would come from below the horizon comes from the mirror direction.
        let s = select(-own, sent, dot(sent, sent) < 1.0);
        let light = vec3(cosine * s.x - sine * s.y, sine * s.x + cosine * s.y, sqrt(max(1.0 - dot(s, s), 0.0)));
        let towards = hit.across * light.x + hit.along * light.y + hit.up * light.z;
        if !shaded(hit, towards, 1e30) {
            sum += sky_seen(sky_at(towards), number) * (step * sqrt(scene.detail.z) * reflectance(half_cos(view, light), number));
        }
    }
    return sum;
}

// What is seen of the sky, linear sRGB.
fn under(view: vec3<f32>, hit: Hit, at: Groove, u: vec4<f32>) -> vec3<f32> {
    let kind = scene.what.x;
    let covered = covered_part(at);
    var sum = vec3(0.0);
    if covered > 0.0 {
        if kind == 2.0 && scene.form.x == 0.0 {
            sum = covered * over_view(under_top, view);
        } else if kind == 2.0 {
            sum = covered * table_under(view, hit, u.xyz);
        } else if kind == 4.0 {
            sum = covered * linear_srgb(lattice_under(view, hit, u));
        } else if kind == 5.0 {
            sum = covered * linear_srgb(heights_under(view, hit, u));
        } else {
            let share = select(1.0, scene.detail.z, kind == 3.0);
            sum = covered * share * linear_srgb(grating_under(view, hit, at, u));
        }
    }
    if scene.albedo.w > 0.0 {
        if scene.form.x == 0.0 {
            sum += base_under(view, covered);
        } else {
            sum += rough_under(view, hit, covered, u.xyz);
        }
    }
    return sum;
}
