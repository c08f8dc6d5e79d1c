// Tables over half vectors (table.rs) and rough surfaces (base.rs).

// An entry of a table at a half vector; dark outside.
fn table_entry(h: vec2<f32>) -> vec3<f32> {
    let extent = scene.table.x;
    if max(abs(h.x), abs(h.y)) > extent {
        return vec3(0.0);
    }
    // The first row is the uppermost.
    let s = vec2(h.x, -h.y) / extent;
    let even = sign(s) * pow(abs(s), vec2(1.0 / scene.table.y));
    let size = vec2<f32>(textureDimensions(half_vectors));
    return smooth_at(half_vectors, (even + 1.0) * 0.5 * size - 0.5).xyz;
}

// BRDF times the cosine of the light, linear sRGB under the table's own light.
fn table_lit(view: vec3<f32>, light: vec3<f32>) -> vec3<f32> {
    let aligned = 1.0 + dot(view, light);
    let last = vec2<f32>(textureDimensions(half_albedo)) - 1.0;
    let place = (clamp(view.xy / 0.999, vec2(-1.0), vec2(1.0)) + 1.0) * 0.5 * last;
    let albedo = smooth_at(half_albedo, place).xyz;
    // What comes in at most goes out.
    let whole = select(max(albedo, vec3(view.z)), albedo, scene.table.w > 0.0);
    return table_entry(view.xy + light.xy) * (scene.table.z * aligned * aligned) / max(whole, vec3(1e-9));
}

fn rough_at(cosine: f32, alpha: f32) -> vec4<f32> {
    let last = vec2<f32>(textureDimensions(rough)) - 1.0;
    return smooth_at(rough, vec2(clamp(cosine, 0.0, 1.0), min(sqrt(max(alpha - 0.02, 0.0) / 0.98), 1.0)) * last);
}

// What comes out of further reflections, of what a first one has not let out.
fn again(f0: vec3<f32>, mean: f32) -> vec3<f32> {
    let fresnel = select(vec3(0.0), f0 + (1.0 - f0) / 21.0, f0 > vec3(0.0));
    return fresnel * fresnel * mean / (1.0 - fresnel * (1.0 - mean));
}

fn glossy(f0: vec3<f32>, t: vec4<f32>) -> vec3<f32> {
    return f0 * t.x + select(vec3(0.0), vec3(t.y), f0 > vec3(0.0)) + again(f0, t.z) * (1.0 - t.x - t.y);
}

fn smith(cosine: f32, alpha: f32) -> f32 {
    let tangent = max(1.0 - cosine * cosine, 0.0) / max(cosine * cosine, 1e-12);
    return 0.5 * (sqrt(1.0 + alpha * alpha * tangent) - 1.0);
}

// BRDF of a rough surface times the cosine of the light, linear sRGB.
fn rough_lit(view: vec3<f32>, light: vec3<f32>) -> vec3<f32> {
    let alpha = scene.albedo.w;
    let f0 = scene.specular.xyz;
    let half = normalize(view + light);
    let d = half.z * half.z * (alpha * alpha - 1.0) + 1.0;
    let distribution = alpha * alpha / (PI * d * d);
    let facets = distribution / (1.0 + smith(light.z, alpha) + smith(view.z, alpha)) / (4.0 * light.z * view.z);
    let edge = pow(clamp(1.0 - dot(light, half), 0.0, 1.0), 5.0);
    let schlick = f0 + select(vec3(0.0), vec3(edge), f0 > vec3(0.0)) - f0 * edge;
    let o = rough_at(view.z, alpha);
    let i = rough_at(light.z, alpha);
    let rest = (1.0 - o.x - o.y) * (1.0 - i.x - i.y) / (PI * max(1.0 - o.z, 1e-9));
    let shine = facets * schlick + again(f0, o.z) * rest;
    let mean = f0 * (o.z - o.w) + select(vec3(0.0), vec3(o.w), f0 > vec3(0.0)) + again(f0, o.z) * (1.0 - o.z);
    let left = (1.0 - glossy(f0, o)) * (1.0 - glossy(f0, i)) / max(1.0 - mean, vec3(1e-9));
    return (shine + scene.albedo.xyz * left / PI) * light.z;
}

// A direction of light for three numbers from 0 to 1: half of them by the cosine, half by the glossy lobe (Heitz 2018).
fn rough_drawn(view: vec3<f32>, u: vec3<f32>) -> vec3<f32> {
    let phi = 2.0 * PI * u.y;
    if u.z < 0.5 {
        return vec3(sqrt(u.x) * vec2(cos(phi), sin(phi)), sqrt(max(1.0 - u.x, 0.0)));
    }
    let alpha = scene.albedo.w;
    let v = normalize(vec3(alpha * view.xy, view.z));
    let across = length(v.xy);
    let s = select(vec3(1.0, 0.0, 0.0), vec3(-v.y, v.x, 0.0) / max(across, 1e-9), across > 1e-6);
    let p = sqrt(u.x) * cos(phi);
    let share = 0.5 * (1.0 + v.z);
    let q = (1.0 - share) * sqrt(max(1.0 - p * p, 0.0)) + share * sqrt(u.x) * sin(phi);
    let n = p * s + q * cross(v, s) + sqrt(max(1.0 - p * p - q * q, 0.0)) * v;
    let half = normalize(vec3(alpha * n.xy, max(n.z, 1e-6)));
    return 2.0 * dot(view, half) * half - view;
}

// Density of rough_drawn per solid angle.
fn rough_density(light: vec3<f32>, view: vec3<f32>) -> f32 {
    let alpha = scene.albedo.w;
    let half = normalize(view + light);
    let d = half.z * half.z * (alpha * alpha - 1.0) + 1.0;
    let distribution = alpha * alpha / (PI * d * d);
    return 0.5 * light.z / PI + 0.5 * distribution / (1.0 + smith(view.z, alpha)) / (4.0 * max(view.z, 1e-6));
}
