// A picture on a screen: what is too bright is compressed, what no screen shows loses saturation (as the processor's PNG).

struct Show {
    values: vec4<f32>, // exposure; 1 where the picture's colours are no light; width and height of the screen, below 0 where its rows are counted from above
}

@group(0) @binding(0) var<uniform> show: Show;
@group(0) @binding(1) var picture: texture_2d<f32>;

fn texel(at: vec2<i32>, last: vec2<i32>) -> vec4<f32> {
    return textureLoad(picture, clamp(at, vec2(0), last), 0);
}

fn encoded(light: vec3<f32>) -> vec3<f32> {
    let v = clamp(light, vec3(0.0), vec3(1.0));
    return select(1.055 * pow(v, vec3(1.0 / 2.4)) - 0.055, 12.92 * v, v <= vec3(0.0031308));
}

@fragment
fn display(@builtin(position) position: vec4<f32>) -> @location(0) vec4<f32> {
    let size = vec2<i32>(textureDimensions(picture));
    // Row 0 of the picture is its uppermost; a canvas of WebGL counts from below.
    let row = position.y / show.values.w;
    let place = vec2(position.x / show.values.z, select(1.0 - row, -row, row < 0.0)) * vec2<f32>(size) - 0.5;
    let low = vec2<i32>(floor(place));
    let t = place - floor(place);
    let last = size - 1;
    let top = mix(texel(low, last), texel(low + vec2(1, 0), last), t.x);
    let bottom = mix(texel(low + vec2(0, 1), last), texel(low + vec2(1, 1), last), t.x);
    let found = mix(top, bottom, t.y);
    if show.values.y > 0.0 {
        return vec4(encoded(found.rgb), 1.0);
    }
    let rgb = found.rgb * show.values.x;
    let luminance = max(dot(rgb, vec3(0.2126729, 0.7151522, 0.072175)), 0.0);
    let least = min(luminance, min(rgb.r, min(rgb.g, rgb.b)));
    let most = max(1e-9, max(rgb.r, max(rgb.g, rgb.b)));
    let kept = select(1.0, luminance / (luminance - least), least < 0.0);
    return vec4(encoded((luminance + kept * (rgb - luminance)) / (1.0 + most)), 1.0);
}
