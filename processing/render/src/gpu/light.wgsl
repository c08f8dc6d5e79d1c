// A picture of one sample under lights or a sky, linear sRGB: each run adds samples to what is there.

// What is seen of a colour, as the processor does it.
fn linear_srgb(xyz: vec3<f32>) -> vec3<f32> {
    return vec3(
        3.2404542 * xyz.x - 1.5371385 * xyz.y - 0.4985314 * xyz.z,
        -0.969266 * xyz.x + 1.8760108 * xyz.y + 0.041556 * xyz.z,
        0.0556434 * xyz.x - 0.2040259 * xyz.y + 1.0572252 * xyz.z,
    );
}

struct Beam {
    towards: vec3<f32>,
    width: f32,
    illuminance: f32,
    distance: f32,
}

// Parts of a rectangle along each side; a sample sees one of them.
const STRATA: f32 = 4.0;

fn rectangle(lamp: i32, point: vec3<f32>, sample: f32, u: vec2<f32>) -> Beam {
    let across = scene.lights[LIGHT_ROWS * lamp + 3].xyz;
    let along = scene.lights[LIGHT_ROWS * lamp + 4].xyz;
    // All of them in turn, neighbours not one after the other.
    let part = (7.0 * sample) % (STRATA * STRATA);
    let cell = vec2(part % STRATA, floor(part / STRATA));
    let at = 2.0 * (cell + u) / STRATA - 1.0;
    let d = scene.lights[LIGHT_ROWS * lamp].xyz + across * at.x + along * at.y - point;
    let distance = max(length(d), 1e-6);
    let towards = d / distance;
    let cosine = max(-dot(towards, normalize(cross(across, along))), 0.0);
    // A square cell blurred as much as it is wide, by its own cosine.
    let area = 4.0 * length(across) * length(along) / (STRATA * STRATA);
    let width = max(sqrt(area * cosine / 12.0) / distance, 1e-6);
    return Beam(towards, width, scene.lights[LIGHT_ROWS * lamp + 1].x * cosine / (distance * distance), distance);
}

fn beam(lamp: i32, point: vec3<f32>, sample: f32, u: vec2<f32>) -> Beam {
    let place = scene.lights[LIGHT_ROWS * lamp];
    let shine = scene.lights[LIGHT_ROWS * lamp + 1];
    let aim = scene.lights[LIGHT_ROWS * lamp + 3];
    if shine.y == 1.0 {
        return Beam(place.xyz, max(place.w, 1e-6), shine.x, 1e30);
    }
    if shine.y == 2.0 {
        return rectangle(lamp, point, sample, u);
    }
    let d = place.xyz - point;
    let distance = max(length(d), 1e-6);
    let towards = d / distance;
    var falls = 1.0;
    if aim.w > 0.0 {
        let angle = acos(clamp(-dot(towards, aim.xyz), -1.0, 1.0)) / aim.w;
        falls = exp(-0.5 * angle * angle);
    }
    return Beam(towards, max(place.w / distance, 1e-6), shine.x * falls / (distance * distance), distance);
}

// The part of a place that diffracts; what does not is base.
fn covered_part(at: Groove) -> f32 {
    let masked = scene.what.x == 1.0 && at.sigma < 0.0;
    return select(scene.what.w, 0.0, scene.what.x == 0.0 || masked);
}

// What of the base is seen beside and through what covers a part of it.
fn below(covered: f32, view: vec3<f32>, light: vec3<f32>) -> f32 {
    var share = 1.0 - covered;
    if scene.specular.w > 0.0 {
        let middle = 1.0 / 0.55;
        share += covered * (1.0 - reflectance(view.z, middle)) * (1.0 - reflectance(light.z, middle));
    }
    return share;
}

// What is seen of a light of illuminance 1 on what faces it.
fn lit(view: vec3<f32>, light: vec3<f32>, width: f32, lamp: i32, at: Groove) -> vec3<f32> {
    let white = scene.lights[LIGHT_ROWS * lamp + 2].xyz;
    let kind = scene.what.x;
    let covered = covered_part(at);
    var top = vec3(0.0);
    if covered > 0.0 {
        if kind == 1.0 {
            top = linear_srgb(grating_lit(view, light, width, lamp, at)) * light.z;
        } else if kind == 2.0 {
            top = table_lit(view, light) * white;
        } else if kind == 3.0 {
            if at.sigma >= 0.0 {
                top = linear_srgb(slits_lit(view, light, width, lamp, at)) * light.z;
            }
        } else if kind >= 4.0 {
            top = linear_srgb(field_lit(view, light, width, lamp));
        }
    }
    if scene.albedo.w <= 0.0 {
        return covered * top;
    }
    return covered * top + below(covered, view, light) * rough_lit(view, light) * white;
}

// Linear sRGB of an orientation in half turns: the palette `cyclic` of processing/image/src/palette.rs, which explains it.
fn cyclic(turns: f32) -> vec3<f32> {
    let p = 6.2831853 * turns;
    let first = 5.847 + p - 0.009 * cos(p) - 0.030 * sin(p) - 0.090 * cos(2.0 * p) + 0.052 * sin(2.0 * p);
    let u = first + 0.003 * cos(3.0 * p) - 0.027 * sin(3.0 * p) + 0.014 * cos(4.0 * p) + 0.007 * cos(5.0 * p) - 0.005 * sin(5.0 * p);
    let lightness = 0.566 + 0.368 * cos(u);
    let a = -0.007 - 0.041 * cos(u) - 0.057 * sin(u);
    let b = 0.017 * cos(u) - 0.094 * sin(u);
    let l = lightness + 0.39633778 * a + 0.21580376 * b;
    let m = lightness - 0.10556135 * a - 0.06385417 * b;
    let s = lightness - 0.08948418 * a - 1.2914855 * b;
    let red = 4.0767417 * l * l * l - 3.3077116 * m * m * m + 0.23096993 * s * s * s;
    let green = -1.268438 * l * l * l + 2.6097574 * m * m * m - 0.3413194 * s * s * s;
    let blue = -0.0041960863 * l * l * l - 0.7034186 * m * m * m + 1.7076147 * s * s * s;
    return vec3(red, green, blue);
}

// From dark to light: the colours of numbers in the maps' pictures.

fn rising(t: f32) -> vec3<f32> {
    // The sixth-order fit of viridis by M. Zucker (CC0).
    let x = clamp(t, 0.0, 1.0);
    var v = vec3(-5.435456, 4.6458526, 26.312435);
    v = v * x + vec3(4.776385, -13.745145, -65.353033);
    v = v * x + vec3(6.22827, 14.179933, 56.69055);
    v = v * x + vec3(-4.6342305, -5.799101, -19.332441);
    v = v * x + vec3(-0.33086183, 0.21484756, 0.095095165);
    v = v * x + vec3(0.10509304, 1.4046135, 1.3845901);
    return clamp(v * x + vec3(0.27772733, 0.0054073445, 0.3340998), vec3(0.0), vec3(1.0));
}

fn linear_of_srgb(v: vec3<f32>) -> vec3<f32> {
    return select(pow((v + 0.055) / 1.055, vec3(2.4)), v / 12.92, v <= vec3(0.04045));
}

// Orientation, period or σ in place of light.
fn overlay(at: Groove) -> vec3<f32> {
    if at.sigma < 0.0 {
        return vec3(0.02);
    }
    let show = scene.what.z;
    if show == 1.0 {
        return cyclic(atan2(at.across.y, at.across.x) / PI);
    }
    let value = select(at.sigma, at.period, show == 2.0);
    let ends = select(scene.range.zw, scene.range.xy, show == 2.0);
    return linear_of_srgb(rising((value - ends.x) / max(ends.y - ends.x, 1e-9)));
}

// What is seen where there is nothing.
fn beyond(ray: vec3<f32>) -> vec4<f32> {
    if scene.sky_y.w > 0.0 {
        return vec4(sky_at(ray), 1.0);
    }
    return vec4(0.0);
}

// Linear sRGB of a place of the picture, in pixels from its upper left corner; u are numbers by chance.
fn seen_at(pixel: vec2<f32>, sample: f32, u: vec4<f32>) -> vec4<f32> {
    let size = vec2(scene.right.w, scene.up.w);
    let x = (2.0 * pixel.x - size.x) / size.y * scene.eye.w;
    let y = (1.0 - 2.0 * pixel.y / size.y) * scene.eye.w;
    let ray = normalize(scene.ahead.xyz + scene.right.xyz * x + scene.up.xyz * y);
    let hit = met(scene.eye.xyz, ray);
    if hit.distance < 0.0 {
        return beyond(ray);
    }
    let found = groove(hit.uv);
    if scene.what.z > 0.0 {
        return vec4(overlay(found), 1.0);
    }
    let view = vec3(dot(hit.across, -ray), dot(hit.along, -ray), dot(hit.up, -ray));
    var sum = vec3(0.0);
    // Whether there are lamps is settled before shaders are compiled: without, compilers leave the loop out.
    if scene.what.y > 0.0 {
        for (var lamp = 0; lamp < min(i32(scene.what.y), 8); lamp++) {
            let source = beam(lamp, hit.point, sample, u.xy);
            let light = vec3(dot(hit.across, source.towards), dot(hit.along, source.towards), dot(hit.up, source.towards));
            let faces = light.z > 0.0 && view.z > 0.0 && dot(hit.face, source.towards) > 0.0;
            if faces && source.illuminance > 0.0 && !shaded(hit, source.towards, source.distance) {
                sum += lit(view, light, source.width, lamp, found) * source.illuminance;
            }
        }
    }
    if scene.sky_x.w > 0.0 {
        if view.z > 0.0 {
            sum += under(view, hit, found, u);
        }
    }
    return vec4(sum, 1.0);
}

// A pixel, by its upper left corner.
fn drawn(corner: vec2<f32>) -> vec4<f32> {
    let count = i32(scene.samples.y);
    var sum = vec4(0.0);
    for (var k = 0; k < count; k++) {
        // Even places within the pixel (Roberts' R2 sequence), the middle first.
        let n = scene.samples.x + f32(k);
        sum += seen_at(corner + fract(vec2(0.5) + n * vec2(0.75487767, 0.56984029)), n, chance(corner, n));
    }
    let mean = sum / max(f32(count), 1.0);
    if scene.samples.z <= 0.0 {
        return mean;
    }
    return mix(mean, textureLoad(before, vec2<i32>(corner), 0), scene.samples.z);
}

@fragment
fn light(@builtin(position) position: vec4<f32>) -> @location(0) vec4<f32> {
    return drawn(floor(position.xy));
}
