//! Gratings as a quad in USD, with the OpenPBR surface of MaterialX and a preview without anisotropy.

use super::materialx::{self, GRAPH, Link, OUTPUTS};
use super::surface::{ALPHA_ALONG, Surface};
use std::fmt::Write;

/// The text of a `.usda` file: a quad in the xy plane that faces +z, in mm, around the origin.
pub fn text(surface: &Surface) -> String {
    let [x, y] = surface.size_mm.map(|side| side / 2.0);
    let lost: String = surface.lost.iter().map(|line| format!("{}\n", line.replace('"', "'"))).collect();
    format!(
        r#"#usda 1.0
(
    defaultPrim = "Sample"
    metersPerUnit = 0.001
    upAxis = "Y"
    doc = """Losses and assumptions:
{lost}"""
)

def Xform "Sample" (
    kind = "component"
)
{{
    def Mesh "Quad" (
        prepend apiSchemas = ["MaterialBindingAPI"]
    )
    {{
        float3[] extent = [({left}, {below}, 0), ({x}, {y}, 0)]
        int[] faceVertexCounts = [4]
        int[] faceVertexIndices = [0, 1, 2, 3]
        point3f[] points = [({left}, {below}, 0), ({x}, {below}, 0), ({x}, {y}, 0), ({left}, {y}, 0)]
        normal3f[] normals = [(0, 0, 1), (0, 0, 1), (0, 0, 1), (0, 0, 1)] (
            interpolation = "vertex"
        )
        texCoord2f[] primvars:st = [(0, 0), (1, 0), (1, 1), (0, 1)] (
            interpolation = "vertex"
        )
        uniform token subdivisionScheme = "none"
        rel material:binding = </Sample/Grating>
    }}

{material}}}
"#,
        left = -x,
        below = -y,
        material = material(surface),
    )
}

/// Path of the material.
const MATERIAL: &str = "/Sample/Grating";

/// The material: both surfaces, and the nodes.
fn material(surface: &Surface) -> String {
    let [r, g, b] = surface.reflectance;
    // The preview is isotropic: the geometric mean of both slopes.
    let roughness = (surface.alpha_across * ALPHA_ALONG).sqrt().sqrt();
    let mut text = format!(
        r#"    def Material "Grating"
    {{
        token outputs:surface.connect = <{MATERIAL}/Preview.outputs:surface>
        token outputs:mtlx:surface.connect = <{MATERIAL}/OpenPbr.outputs:out>

        def Shader "Preview"
        {{
            uniform token info:id = "UsdPreviewSurface"
            color3f inputs:diffuseColor = ({r:.4}, {g:.4}, {b:.4})
            float inputs:metallic = 1
            float inputs:roughness = {roughness:.4}
            token outputs:surface
        }}

        def Shader "OpenPbr"
        {{
            uniform token info:id = "ND_open_pbr_surface_surfaceshader"
"#
    );
    for (name, kind, value) in materialx::constants(surface) {
        let value = if kind == "color3" { format!("({value})") } else { value };
        let _ = writeln!(text, "            {} inputs:{name} = {value}", usd_type(kind));
    }
    for (name, kind, _) in OUTPUTS {
        let kind = usd_type(kind);
        let _ = writeln!(text, "            {kind} inputs:{name}.connect = <{MATERIAL}/{GRAPH}.outputs:{name}>");
    }
    let _ =
        write!(text, "            token outputs:out\n        }}\n\n        def NodeGraph \"{GRAPH}\"\n        {{\n");
    for (name, kind, node) in OUTPUTS {
        let kind = usd_type(kind);
        let _ = writeln!(text, "            {kind} outputs:{name}.connect = <{MATERIAL}/{GRAPH}/{node}.outputs:out>");
    }
    text += &nodes();
    text += "        }\n    }\n";
    text
}

/// The nodes of MaterialX as shaders.
fn nodes() -> String {
    let mut text = String::new();
    for node in materialx::nodes() {
        let _ = write!(text, "\n            def Shader \"{}\"\n            {{\n", node.name);
        let _ = writeln!(text, "                uniform token info:id = \"ND_{}_{}\"", node.category, node.variant);
        for (name, kind, link) in &node.inputs {
            let (kind, is_text) = (usd_type(kind), *kind == "string");
            let _ = match link {
                Link::Value(file) if kind == "asset" => {
                    writeln!(text, "                asset inputs:{name} = @{file}@")
                }
                Link::Value(value) if is_text => writeln!(text, "                string inputs:{name} = \"{value}\""),
                Link::Value(value) => writeln!(text, "                {kind} inputs:{name} = {value}"),
                Link::Node(from, output) => {
                    let output = if output.is_empty() { "out" } else { output };
                    let path = format!("{MATERIAL}/{GRAPH}/{from}.outputs:{output}");
                    writeln!(text, "                {kind} inputs:{name}.connect = <{path}>")
                }
            };
        }
        let outputs: &[&str] = if node.kind == "multioutput" { &["outx", "outy", "outz"] } else { &["out"] };
        let kind = if node.kind == "multioutput" { "float" } else { usd_type(node.kind) };
        outputs.iter().for_each(|output| text += &format!("                {kind} outputs:{output}\n"));
        text += "            }\n";
    }
    text
}

/// Type in USD of a type in MaterialX.
fn usd_type(kind: &str) -> &'static str {
    match kind {
        "color3" => "color3f",
        "vector3" => "float3",
        "filename" => "asset",
        "string" => "string",
        _ => "float",
    }
}
