// The sample's shape, and where rays meet it (shape.rs).

// Where a ray meets the sample: distance, below 0 where it does not; place; the shape's own normal towards the ray; directions of u and v and the
// normal that light sees; u and v.
struct Hit {
    distance: f32,
    point: vec3<f32>,
    face: vec3<f32>,
    across: vec3<f32>,
    along: vec3<f32>,
    up: vec3<f32>,
    uv: vec2<f32>,
}

const NOWHERE: Hit = Hit(-1.0, vec3(0.0), vec3(0.0), vec3(0.0), vec3(0.0), vec3(0.0), vec2(0.0));

// A plane or disc.
fn flat_met(start: vec3<f32>, ray: vec3<f32>) -> Hit {
    let slope = dot(ray, scene.normal.xyz);
    let distance = dot(scene.center.xyz - start, scene.normal.xyz) / slope;
    let point = start + ray * distance;
    let p = point - scene.center.xyz;
    let at = vec2(dot(p, scene.across.xyz), dot(p, scene.along.xyz));
    let half = vec2(scene.center.w, scene.across.w);
    let radius = length(at);
    let inside = select(all(abs(at) <= half), radius >= scene.along.w && radius <= scene.normal.w, scene.normal.w > 0.0);
    if abs(slope) <= 1e-9 || distance <= 0.0 || !inside {
        return NOWHERE;
    }
    let up = scene.normal.xyz * -sign(slope);
    return Hit(distance, point, up, scene.across.xyz, scene.along.xyz, up, 0.5 + 0.5 * at / half);
}

// A part of a cylinder, beyond a distance: its axis is the normal, from the direction of `across` on.
fn cylinder_met(start: vec3<f32>, ray: vec3<f32>, near: f32) -> Hit {
    let axis = scene.normal.xyz;
    let o = start - scene.center.xyz;
    let a = o - axis * dot(o, axis);
    let b = ray - axis * dot(ray, axis);
    // From the place next to the axis half a chord to both sides.
    let middle = -dot(a, b) / max(dot(b, b), 1e-12);
    let off = a + b * middle;
    let square = (scene.across.w * scene.across.w - dot(off, off)) / max(dot(b, b), 1e-12);
    var found = NOWHERE;
    for (var k = 0; k < 2; k++) {
        let distance = middle + (f32(2 * k) - 1.0) * sqrt(max(square, 0.0));
        let p = o + ray * distance;
        let height = dot(p, axis);
        let angle = (atan2(dot(p, scene.along.xyz), dot(p, scene.across.xyz)) - scene.along.w) / (2.0 * PI);
        let turn = fract(angle) * 2.0 * PI / -scene.normal.w;
        if found.distance < 0.0 && square >= 0.0 && distance > near && abs(height) <= scene.center.w && turn <= 1.0 {
            let n = normalize(p - axis * height);
            let up = n * -sign(dot(n, ray));
            let uv = vec2(turn, 0.5 + 0.5 * height / scene.center.w);
            found = Hit(distance, p + scene.center.xyz, up, cross(axis, n), axis, up, uv);
        }
    }
    return found;
}

// A sphere, beyond a distance: its axis is the normal, from the direction of `across` on.
fn sphere_met(start: vec3<f32>, ray: vec3<f32>, near: f32) -> Hit {
    let o = start - scene.center.xyz;
    let middle = -dot(o, ray);
    let off = o + ray * middle;
    let square = scene.center.w * scene.center.w - dot(off, off);
    let half = sqrt(max(square, 0.0));
    let distance = select(middle + half, middle - half, middle - half > near);
    if square < 0.0 || distance <= near {
        return NOWHERE;
    }
    let n = normalize(o + ray * distance);
    let turn = fract(atan2(dot(n, scene.along.xyz), dot(n, scene.across.xyz)) / (2.0 * PI));
    let v = 1.0 - acos(clamp(dot(n, scene.normal.xyz), -1.0, 1.0)) / PI;
    let around = cross(scene.normal.xyz, n);
    // At the poles along the start.
    let across = select(scene.along.xyz, normalize(around), length(around) > 1e-6);
    let up = n * -sign(dot(n, ray));
    return Hit(distance, scene.center.xyz + n * scene.center.w, up, across, cross(n, across), up, vec2(turn, v));
}

fn mesh_texel(k: i32) -> vec4<f32> {
    let width = i32(textureDimensions(mesh).x);
    return textureLoad(mesh, vec2(k % width, k / width), 0);
}

// The corner of a triangle: place and u, normal and v, tangent.
fn corner_texel(triangle: i32, corner: i32, which: i32) -> vec4<f32> {
    return mesh_texel(2 * i32(scene.form.y) + 9 * triangle + 3 * corner + which);
}

// Distance, and weights of the second and third corner (Möller and Trumbore 1997); distance below 0 where it is missed.
fn triangle_met(triangle: i32, start: vec3<f32>, ray: vec3<f32>) -> vec3<f32> {
    let a = corner_texel(triangle, 0, 0).xyz;
    let p = corner_texel(triangle, 1, 0).xyz - a;
    let q = corner_texel(triangle, 2, 0).xyz - a;
    let h = cross(ray, q);
    let det = dot(p, h);
    if det == 0.0 {
        return vec3(-1.0);
    }
    let s = (start - a) / det;
    let w = cross(s, p);
    let weights = vec2(dot(s, h), dot(ray, w));
    if min(weights.x, weights.y) < 0.0 || weights.x + weights.y > 1.0 {
        return vec3(-1.0);
    }
    return vec3(dot(q, w), weights);
}

// The nearest triangle within distances: its number, below 0 for none; distance and weights.
fn nearest_triangle(start: vec3<f32>, ray: vec3<f32>, near: f32, far: f32) -> vec4<f32> {
    var found = vec4(-1.0, far, 0.0, 0.0);
    let inverse = 1.0 / select(ray, vec3(1e-20), abs(ray) < vec3(1e-20));
    // The tree is balanced: so many levels hold more triangles than a texture.
    var stack: array<i32, 32>;
    stack[0] = 0;
    var depth = 1;
    while depth > 0 {
        depth--;
        let index = stack[depth];
        let low = mesh_texel(2 * index);
        let high = mesh_texel(2 * index + 1);
        let a = (low.xyz - start) * inverse;
        let b = (high.xyz - start) * inverse;
        let first = min(a, b);
        let last = max(a, b);
        // A little wider than it is, for rounding.
        let begins = max(max(first.x, first.y), first.z) * (1.0 - 1e-6);
        let ends = min(min(last.x, last.y), last.z) * (1.0 + 1e-6);
        if max(begins, near) > min(ends, found.y) {
            continue;
        }
        if high.w == 0.0 {
            stack[depth] = i32(low.w);
            stack[depth + 1] = index + 1;
            depth += 2;
            continue;
        }
        for (var k = i32(low.w); k < i32(low.w + high.w); k++) {
            let hit = triangle_met(k, start, ray);
            if hit.x > near && hit.x < found.y {
                found = vec4(f32(k), hit);
            }
        }
    }
    return found;
}

// Some direction across a normal.
fn any_across(n: vec3<f32>) -> vec3<f32> {
    let axis = select(vec3(0.0, 1.0, 0.0), vec3(1.0, 0.0, 0.0), abs(n.x) < 0.9);
    return normalize(axis - n * dot(n, axis));
}

// A mesh with smooth normals and tangents (mesh.rs says why).
fn mesh_met(start: vec3<f32>, ray: vec3<f32>) -> Hit {
    let found = nearest_triangle(start, ray, 0.0, 1e30);
    if found.x < 0.0 {
        return NOWHERE;
    }
    let k = i32(found.x);
    let w = vec3(1.0 - found.z - found.w, found.zw);
    let a = corner_texel(k, 0, 0);
    let p = corner_texel(k, 1, 0) - a;
    let q = corner_texel(k, 2, 0) - a;
    let na = corner_texel(k, 0, 1);
    let np = corner_texel(k, 1, 1);
    let nq = corner_texel(k, 2, 1);
    let flat = normalize(cross(p.xyz, q.xyz));
    let mixed = na.xyz * w.x + np.xyz * w.y + nq.xyz * w.z;
    let smooth_normal = select(flat, normalize(mixed), length(mixed) > 1e-6);
    // Where (u, v) are mirrored, so is the frame.
    let mirrored = (p.w * (nq.w - na.w) - (np.w - na.w) * q.w) * dot(flat, smooth_normal) < 0.0;
    let tangent = corner_texel(k, 0, 2).xyz * w.x + corner_texel(k, 1, 2).xyz * w.y + corner_texel(k, 2, 2).xyz * w.z;
    let beside = tangent - smooth_normal * dot(tangent, smooth_normal);
    let across = select(any_across(smooth_normal), normalize(beside), length(beside) > 1e-6);
    let along = cross(smooth_normal, across) * select(1.0, -1.0, mirrored);
    // Both on one side, and on the ray's.
    let outward = flat * select(1.0, -1.0, dot(flat, smooth_normal) < 0.0);
    let front = select(1.0, -1.0, dot(outward, ray) > 0.0);
    var up = smooth_normal * front;
    // A smoothed normal that looks away from the viewer shades as if seen edge-on.
    let away = dot(up, ray);
    if away > -1e-3 {
        up = normalize(up - ray * (away + 1e-3));
    }
    let uv = vec2(a.w + p.w * w.y + q.w * w.z, na.w * w.x + np.w * w.y + nq.w * w.z);
    return Hit(found.y, start + ray * found.y, outward * front, across, along, up, uv);
}

fn met(start: vec3<f32>, ray: vec3<f32>) -> Hit {
    if scene.form.x == 1.0 {
        return cylinder_met(start, ray, 0.0);
    }
    if scene.form.x == 2.0 {
        return sphere_met(start, ray, 0.0);
    }
    if scene.form.x == 3.0 {
        return mesh_met(start, ray);
    }
    return flat_met(start, ray);
}

// Whether the sample itself is in the way of light from a direction and a distance; what is flat shades nothing of itself.
fn shaded(hit: Hit, towards: vec3<f32>, distance: f32) -> bool {
    var far = -1.0;
    if scene.form.x == 1.0 {
        far = cylinder_met(hit.point, towards, 1e-3 * scene.across.w).distance;
    } else if scene.form.x == 2.0 {
        far = sphere_met(hit.point, towards, 1e-3 * scene.center.w).distance;
    } else if scene.form.x == 3.0 {
        // A little off the surface, so that it does not shade itself.
        let start = hit.point + hit.face * (1e-5 * (hit.distance + length(hit.point)));
        let found = nearest_triangle(start, towards, 0.0, distance);
        far = select(-1.0, found.y, found.x >= 0.0);
    }
    return far > 0.0 && far < distance;
}
