//! Gratings as an OpenPBR surface in MaterialX.
//!
//! The nodes are a table, since USD writes the same nodes in its own syntax.

use super::surface::{ALPHA_ALONG, Surface, TEXTURE};
use std::fmt::Write;

/// Name of the node graph.
pub const GRAPH: &str = "maps";

/// A node: its name, its category and the type of its output, the rest of its definition's name, and its inputs.
pub struct Node {
    pub name: &'static str,
    pub category: &'static str,
    pub kind: &'static str,
    /// Definition in MaterialX's library is `ND_{category}_{variant}`.
    pub variant: &'static str,
    pub inputs: Vec<Input>,
}

/// An input: its name, its type and its value.
pub type Input = (&'static str, &'static str, Link);

/// Value of an input.
pub enum Link {
    /// Constant as MaterialX writes it.
    Value(String),
    /// Output of a node in the graph; `""` is the only one.
    Node(&'static str, &'static str),
}

/// Outputs of the graph: input of the surface, its type, and the node.
pub const OUTPUTS: [(&str, &str, &str); 3] = [
    ("specular_roughness", "float", "roughness"),
    ("specular_roughness_anisotropy", "float", "anisotropy"),
    ("geometry_tangent", "vector3", "direction"),
];

/// Constants of the surface: input, type, value.
pub fn constants(surface: &Surface) -> [(&'static str, &'static str, String); 2] {
    let [r, g, b] = surface.reflectance;
    [("base_color", "color3", format!("{r:.4}, {g:.4}, {b:.4}")), ("base_metalness", "float", "1".into())]
}

/// Nodes from the texture to direction, roughness r and anisotropy a of OpenPBR, whose slopes are
/// α_t = r² √(2/(1 + (1-a)²)) and α_b = (1-a) α_t. With α_b given and α_t = mix(α_b, 1, strength²), as in glTF,
/// a = 1 - α_b/α_t and r⁴ = (α_t² + α_b²)/2.
pub fn nodes() -> Vec<Node> {
    let along = || Link::Value(ALPHA_ALONG.to_string());
    let value = |v: &str| Link::Value(v.into());
    let of = |name: &'static str| Link::Node(name, "");
    let part = |name: &'static str| Link::Node("parts", name);
    let f = |name: &'static str, category, inputs: Vec<(&'static str, Link)>| Node {
        name,
        category,
        kind: "float",
        variant: "float",
        inputs: inputs.into_iter().map(|(name, link)| (name, "float", link)).collect(),
    };
    let v = |name, category, variant, inputs| Node { name, category, kind: "vector3", variant, inputs };
    let scaled = |name, vector, by| {
        v(name, "multiply", "vector3FA", vec![("in1", "vector3", of(vector)), ("in2", "float", of(by))])
    };
    vec![
        v(
            "texture",
            "image",
            "vector3",
            vec![
                ("file", "filename", value(TEXTURE)),
                ("uaddressmode", "string", value("clamp")),
                ("vaddressmode", "string", value("clamp")),
                // Opposite vectors are one direction, and their mean is none.
                ("filtertype", "string", value("closest")),
            ],
        ),
        Node {
            name: "parts",
            category: "separate3",
            kind: "multioutput",
            variant: "vector3",
            inputs: vec![("in", "vector3", of("texture"))],
        },
        f("right", "remap", vec![("in", part("outx")), ("outlow", value("-1")), ("outhigh", value("1"))]),
        f("up", "remap", vec![("in", part("outy")), ("outlow", value("-1")), ("outhigh", value("1"))]),
        v("tangent", "tangent", "vector3", vec![("space", "string", value("world"))]),
        v("bitangent", "bitangent", "vector3", vec![("space", "string", value("world"))]),
        scaled("to_the_right", "tangent", "right"),
        scaled("upwards", "bitangent", "up"),
        v("sum", "add", "vector3", vec![("in1", "vector3", of("to_the_right")), ("in2", "vector3", of("upwards"))]),
        v("direction", "normalize", "vector3", vec![("in", "vector3", of("sum"))]),
        f("strength_squared", "multiply", vec![("in1", part("outz")), ("in2", part("outz"))]),
        f("across", "mix", vec![("fg", value("1")), ("bg", along()), ("mix", of("strength_squared"))]),
        f("ratio", "divide", vec![("in1", along()), ("in2", of("across"))]),
        f("anisotropy", "subtract", vec![("in1", value("1")), ("in2", of("ratio"))]),
        f("across_squared", "multiply", vec![("in1", of("across")), ("in2", of("across"))]),
        f(
            "squares",
            "add",
            vec![("in1", of("across_squared")), ("in2", Link::Value((ALPHA_ALONG * ALPHA_ALONG).to_string()))],
        ),
        f("mean_square", "multiply", vec![("in1", of("squares")), ("in2", value("0.5"))]),
        f("roughness", "power", vec![("in1", of("mean_square")), ("in2", value("0.25"))]),
    ]
}

/// The document.
pub fn text(surface: &Surface) -> String {
    let mut text = String::from("<?xml version=\"1.0\"?>\n<!-- Losses and assumptions:\n");
    surface.lost.iter().for_each(|line| text += &format!("  {}\n", line.replace("--", "- -")));
    text += "-->\n<materialx version=\"1.39\" colorspace=\"lin_rec709\">\n";
    let _ = writeln!(text, "  <nodegraph name=\"{GRAPH}\">");
    for node in nodes() {
        let _ = writeln!(text, "    <{} name=\"{}\" type=\"{}\">", node.category, node.name, node.kind);
        for (name, kind, link) in &node.inputs {
            let link = match link {
                Link::Value(value) => format!("value=\"{value}\""),
                Link::Node(node, "") => format!("nodename=\"{node}\""),
                Link::Node(node, output) => format!("nodename=\"{node}\" output=\"{output}\""),
            };
            let _ = writeln!(text, "      <input name=\"{name}\" type=\"{kind}\" {link} />");
        }
        let _ = writeln!(text, "    </{}>", node.category);
    }
    for (name, kind, node) in OUTPUTS {
        let _ = writeln!(text, "    <output name=\"{name}\" type=\"{kind}\" nodename=\"{node}\" />");
    }
    text += "  </nodegraph>\n  <open_pbr_surface name=\"grating_surface\" type=\"surfaceshader\">\n";
    for (name, kind, value) in constants(surface) {
        let _ = writeln!(text, "    <input name=\"{name}\" type=\"{kind}\" value=\"{value}\" />");
    }
    for (name, kind, _) in OUTPUTS {
        let _ = writeln!(text, "    <input name=\"{name}\" type=\"{kind}\" nodegraph=\"{GRAPH}\" output=\"{name}\" />");
    }
    text += "  </open_pbr_surface>\n  <surfacematerial name=\"grating\" type=\"material\">\n    \
             <input name=\"surfaceshader\" type=\"surfaceshader\" nodename=\"grating_surface\" />\n  \
             </surfacematerial>\n</materialx>\n";
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nodes_refer_to_earlier_ones() {
        let nodes = nodes();
        let position = |name: &str| nodes.iter().position(|n| n.name == name).unwrap();
        for (k, node) in nodes.iter().enumerate() {
            assert_eq!(position(node.name), k);
            for (_, _, link) in &node.inputs {
                assert!(!matches!(link, Link::Node(from, _) if position(from) >= k), "{}", node.name);
            }
        }
        OUTPUTS.iter().for_each(|(_, kind, node)| assert_eq!(nodes[position(node)].kind, *kind));
    }
}
