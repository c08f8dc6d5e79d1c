//! Consistency of the page's shaders. `shaders.js` (GLSL ES 300 for WebGL2) and `wgsl.js` (WebGPU) hold the shaders of
//! `processing/render/src/gpu`, with the names of their uniforms and textures. They are kept in the repository, because
//! the translator takes longer to compile than the rest of the page. This test compares them with a new translation.

use naga::back::glsl;
use naga::proc::BoundsCheckPolicies;
use naga::valid::{Capabilities, ModuleInfo, ValidationFlags, Validator};
use naga::{AddressSpace, Module, ShaderStage, TypeInner};
use std::error::Error;
use std::fmt::Write;
use std::path::Path;

type Result<T> = std::result::Result<T, Box<dyn Error>>;

const SOURCES: &str = "../processing/render/src/gpu";
const PAGE: &str = "page";
/// Command that regenerates the shaders.
const UPDATE: &str = "run NACRE_UPDATE=1 cargo test -p nacre-web --test shaders";

/// Uniforms that are constant while a scene is shown, and the constants that replace them in browsers, so that
/// compilers eliminate unused branches. Software rendering then compiles in less than one second instead of more than
/// two.
const SETTLED: [(&str, &str); 4] = [("what.x", "KIND"), ("what.y", "LAMPS"), ("form.x", "FORM"), ("sky_x.w", "SKY")];

#[test]
fn scripts_of_the_page_hold_the_shaders() -> Result<()> {
    let light =
        read(&["scene", "shape", "grating", "slits", "field", "surface", "environment", "heights", "corner", "light"])?;
    let display = read(&["corner", "display"])?;
    let mut webgl = String::from("// Made from the shaders in processing/render/src/gpu; see web/tests/shaders.rs.\n");
    webgl += &format!("export const VERTEX = {};\n", text(&translated(&light, ShaderStage::Vertex, "corner")?.0));
    webgl += &format!("/** @type {{Shader}} */\nexport const LIGHT = {};\n", stage(&light, "light")?);
    webgl += &format!("/** @type {{Shader}} */\nexport const DISPLAY = {};\n", stage(&display, "display")?);
    let mut webgpu = String::from("// Made from the shaders in processing/render/src/gpu; see web/tests/shaders.rs.\n");
    webgpu += &format!("/** @type {{DirectShader}} */\nexport const LIGHT = {};\n", direct(&light)?);
    webgpu += &format!("/** @type {{DirectShader}} */\nexport const DISPLAY = {};\n", direct(&display)?);
    for (name, script) in [("shaders.js", webgl), ("wgsl.js", webgpu)] {
        let path = Path::new(PAGE).join(name);
        if std::env::var_os("NACRE_UPDATE").is_some() {
            std::fs::write(path, script)?;
        } else if std::fs::read_to_string(path)? != script {
            return Err(format!("web/page/{name} is not up to date; {UPDATE}").into());
        }
    }
    Ok(())
}

/// Shaders for WebGPU as an object: source, members of the uniform block, and texture bindings. Constant uniforms are
/// replaced.
fn direct(source: &str) -> Result<String> {
    let lines = source.lines().map(|line| line.split("//").next().unwrap_or_default().trim());
    let lines: Vec<&str> = lines.filter(|line| !line.is_empty()).collect();
    let constants = |text: String, (uniform, name): &(&str, &str)| text.replace(&format!("scene.{uniform}"), name);
    let short = SETTLED.iter().fold(lines.join("\n"), constants);
    // As in browsers, with numbers inserted.
    let numbers: String = SETTLED.iter().map(|(_, name)| format!("const {name}: f32 = 1.0;\n")).collect();
    let module = checked(&format!("{numbers}{short}"))?.0;
    let bound = |(_, global): (_, &naga::GlobalVariable)| {
        let texture = matches!(module.types[global.ty].inner, TypeInner::Image { .. });
        Some((global.name.clone()?, global.binding.as_ref()?.binding)).filter(|_| texture)
    };
    let textures: Vec<String> =
        module.global_variables.iter().filter_map(bound).map(|b| format!("[{:?}, {}]", b.0, b.1)).collect();
    Ok(format!("{{ source: {}, members: {}, textures: [{}] }}", text(&short), members(&module)?, textures.join(", ")))
}

/// Parses and validates a shader.
fn checked(source: &str) -> Result<(Module, ModuleInfo)> {
    let module = naga::front::wgsl::parse_str(source).map_err(|e| e.emit_to_string(source))?;
    let mut validator = Validator::new(ValidationFlags::all(), Capabilities::empty());
    let info = validator.validate(&module).map_err(|e| e.emit_to_string(source))?;
    Ok((module, info))
}

fn read(names: &[&str]) -> Result<String> {
    let mut all = String::new();
    for name in names {
        all += &std::fs::read_to_string(format!("{SOURCES}/{name}.wgsl")).map_err(|e| format!("{name}.wgsl: {e}"))?;
    }
    Ok(all)
}

/// A JavaScript string literal.
fn text(source: &str) -> String {
    format!("{source:?}")
}

/// A fragment stage as an object: source, and names of the uniform block, its members and its textures.
fn stage(source: &str, entry: &str) -> Result<String> {
    let (glsl, textures, block, members) = translated(source, ShaderStage::Fragment, entry)?;
    let source = text(&settled(&glsl));
    Ok(format!("{{ source: {source}, block: {}, members: {members}, textures: {textures} }}", text(&block)))
}

/// GLSL with [`SETTLED`] uniforms replaced by preprocessor constants.
fn settled(glsl: &str) -> String {
    let line = |line: &str| {
        let constant = |(uniform, name): &(&str, &str)| {
            let (variable, value) = line.trim_start().strip_prefix("float ")?.split_once(" = ")?;
            let read = value.strip_suffix(&format!(".{uniform};"))?;
            (!read.contains(' ')).then(|| format!("const float {variable} = {name};\n"))
        };
        SETTLED.iter().find_map(constant).unwrap_or_else(|| format!("{}\n", line.trim_start()))
    };
    glsl.lines().map(line).collect()
}

/// GLSL, names of textures, name of the uniform block, and its members with their sizes in vec4.
fn translated(source: &str, shader_stage: ShaderStage, entry: &str) -> Result<(String, String, String, String)> {
    let (module, info) = checked(source)?;
    let version = glsl::Version::new_gles(300);
    let options = glsl::Options { version, writer_flags: glsl::WriterFlags::empty(), ..glsl::Options::default() };
    let pipeline = glsl::PipelineOptions { shader_stage, entry_point: entry.into(), multiview: None };
    let mut out = String::new();
    let policies = BoundsCheckPolicies::default();
    let found = glsl::Writer::new(&mut out, &module, &info, &options, &pipeline, policies)?.write()?;
    let called =
        |handle: naga::Handle<naga::GlobalVariable>| module.global_variables[handle].name.clone().unwrap_or_default();
    let mut named: Vec<(String, &String)> =
        found.texture_mapping.iter().map(|(name, mapping)| (called(mapping.texture), name)).collect();
    named.sort();
    let mut textures = String::from("{");
    for (name, glsl) in named {
        write!(textures, " {name}: {glsl:?},")?;
    }
    textures += " }";
    let block = found.uniforms.values().next().cloned().unwrap_or_default();
    Ok((branchless(&out)?, textures, block, members(&module)?))
}

/// Replaces `(a ? b : c)` in GLSL by calls. WGSL's `select` is branch-free, but `?:` is compiled as a branch. Within a
/// loop, SwiftShader's compile time doubles with each successive branch, and reached minutes for slits.
fn branchless(glsl: &str) -> Result<String> {
    let mut text = glsl.to_owned();
    // The last one contains no other between its `?` and its end.
    while let Some(at) = text.rfind(" ? ") {
        let open = end(text[..at].char_indices().rev(), ')', '(').ok_or("( is missing")?;
        let close = at + end(text[at..].char_indices(), '(', ')').ok_or(") is missing")?;
        let (yes, no) = text[at + 3..close].split_once(" : ").ok_or(": is missing")?;
        let call = format!("pick({no}, {yes}, {})", &text[open + 1..at]);
        text.replace_range(open..=close, &call);
    }
    let precision = "precision highp int;\n";
    Ok(text.replacen(precision, &format!("{precision}{}", picks()), 1))
}

/// Position of the closing bracket, after the opening one.
fn end(characters: impl Iterator<Item = (usize, char)>, opens: char, closes: char) -> Option<usize> {
    let mut within = 0;
    for (at, character) in characters {
        if character == closes && within == 0 {
            return Some(at);
        }
        within += i32::from(character == opens) - i32::from(character == closes);
    }
    None
}

/// Overloads of `pick` for all argument types. In GLSL ES 300, `mix` by a bool accepts floating-point numbers only.
fn picks() -> String {
    let mut all = String::from(
        "bool pick(bool no, bool yes, bool which) { return mix(float(no), float(yes), which) > 0.5; }\n\
         float pick(float no, float yes, bool which) { return mix(no, yes, which); }\n",
    );
    let mut add = |kind: &str, body: &str| {
        all += &format!("{kind} pick({kind} no, {kind} yes, bool which) {{ return {body}; }}\n");
    };
    for n in 2..=4 {
        add(&format!("vec{n}"), &format!("mix(no, yes, bvec{n}(which))"));
    }
    for (scalar, vector) in [("int", "ivec"), ("uint", "uvec")] {
        let body = format!("no + (yes - no) * {scalar}(which)");
        add(scalar, &body);
        (2..=4).for_each(|n| add(&format!("{vector}{n}"), &body));
    }
    all
}

/// Members of the uniform block: `[["eye", 1], …]`.
fn members(module: &Module) -> Result<String> {
    let (_, block) =
        module.global_variables.iter().find(|(_, g)| g.space == AddressSpace::Uniform).ok_or("no uniforms")?;
    let TypeInner::Struct { members, span } = &module.types[block.ty].inner else {
        return Err("uniforms are no struct".into());
    };
    let ends = members.iter().skip(1).map(|m| m.offset).chain([*span]);
    let mut list = String::from("[");
    for (member, end) in members.iter().zip(ends) {
        let name = member.name.as_deref().unwrap_or_default();
        write!(list, "[{name:?}, {}], ", (end - member.offset) / 16)?;
    }
    Ok(list + "]")
}
