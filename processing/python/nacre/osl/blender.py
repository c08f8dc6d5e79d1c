"""The shader in Blender's Cycles: a material, and a scene with a sheet that it covers.

  python -m nacre.osl.blender FILE.png [MAPS]     renders a sheet in the sun; MAPS is a folder of `nacre reconstruct`

Needs `bpy` 4.5 (`pip install bpy==4.5.*`, Python 3.11).
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import bpy  # type: ignore[import-untyped, import-not-found, unused-ignore]
import nacre

from . import shader

# Sockets of the shader and their types. Cycles matches them by name; the wheel of bpy cannot read them from the shader.
SOCKETS = {
    "Orientation_map": "NodeSocketString",
    "Orientation_channel": "NodeSocketInt",
    "Period_map": "NodeSocketString",
    "Period_channel": "NodeSocketInt",
    "Orientation_deg": "NodeSocketFloat",
    "Period_um": "NodeSocketFloat",
    "Profile": "NodeSocketString",
    "Depth_um": "NodeSocketFloat",
    "Duty": "NodeSocketFloat",
    "Coherence_um": "NodeSocketFloat",
    "Reflectance": "NodeSocketColor",
    "Wavelengths": "NodeSocketInt",
    "Part": "NodeSocketInt",
    "UV": "NodeSocketVector",
    "Tangent": "NodeSocketVector",
}
DEFAULTS: dict[str, Any] = {
    "Orientation_map": "",
    "Orientation_channel": 0,
    "Period_map": "",
    "Period_channel": 0,
    "Orientation_deg": 0.0,
    "Period_um": 1.5,
    "Profile": "sinusoid",
    "Depth_um": 0.15,
    "Duty": 0.5,
    "Coherence_um": 65.0,
    "Reflectance": (1.0, 1.0, 1.0, 1.0),
    "Wavelengths": 4,
    "Part": 0,
}


def material(name: str, maps: str | Path | None = None, **options: Any) -> Any:
    """A material with the shader. `maps` is a folder with orientation.exr, period.exr or both; options are sockets."""
    if unknown := set(options) - set(DEFAULTS):
        raise ValueError(f"unknown options {sorted(unknown)}: give some of {sorted(DEFAULTS)}")
    values = {**DEFAULTS, **options}
    for kind in ("Orientation", "Period"):
        file = Path(maps or "") / f"{kind.lower()}.exr"
        if maps and file.exists():
            values[f"{kind}_map"] = str(file.resolve())
            # Channels of a file are in alphabetical order.
            values[f"{kind}_channel"] = sorted(nacre.read_maps(file)).index(kind.lower())
    made = bpy.data.materials.new(name)
    made.use_nodes = True
    tree = made.node_tree
    tree.nodes.clear()
    script = tree.nodes.new("ShaderNodeScript")
    script.mode = "EXTERNAL"
    script.filepath = str(shader())
    for socket, kind in SOCKETS.items():
        found = script.inputs.new(kind, socket)
        if socket in values:
            found.default_value = values[socket]
    script.outputs.new("NodeSocketShader", "BSDF")
    uv, tangent = tree.nodes.new("ShaderNodeUVMap"), tree.nodes.new("ShaderNodeTangent")
    tangent.direction_type = "UV_MAP"
    output = tree.nodes.new("ShaderNodeOutputMaterial")
    tree.links.new(uv.outputs["UV"], script.inputs["UV"])
    tree.links.new(tangent.outputs["Tangent"], script.inputs["Tangent"])
    tree.links.new(script.outputs["BSDF"], output.inputs["Surface"])
    return made


def empty_scene(width: int, height: int, samples: int) -> Any:
    """A scene without objects, rendered by Cycles with shaders of Open Shading Language."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    cycles = scene.cycles
    cycles.device, cycles.shading_system, cycles.samples = "CPU", True, samples
    cycles.use_adaptive_sampling = cycles.use_denoising = False
    # Narrow lobes must not be blurred or clamped.
    cycles.blur_glossy = cycles.sample_clamp_indirect = cycles.sample_clamp_direct = 0.0
    scene.render.resolution_x, scene.render.resolution_y = width, height
    scene.render.film_transparent = True
    scene.world = bpy.data.worlds.new("World")
    scene.world.use_nodes = True
    scene.world.node_tree.nodes["Background"].inputs["Strength"].default_value = 0.0
    return scene


def look_at(item: Any, target: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> None:
    """Turns a camera or lamp towards a point, with y up."""
    from mathutils import Matrix, Vector  # type: ignore[import-untyped, import-not-found, unused-ignore]

    back = (item.location - Vector(target)).normalized()
    right = Vector((0, 1, 0)).cross(back).normalized()
    item.rotation_euler = Matrix((right, back.cross(right), back)).transposed().to_euler()


def add(scene: Any, name: str, data: Any, location: tuple[float, float, float]) -> Any:
    """An object of this data in the scene."""
    item = bpy.data.objects.new(name, data)
    item.location = location
    scene.collection.objects.link(item)
    return item


def main() -> None:
    scene = empty_scene(240, 240, 32)
    bpy.ops.mesh.primitive_plane_add(size=4)
    maps = sys.argv[2] if len(sys.argv) > 2 else None
    bpy.context.object.data.materials.append(material("Grating", maps, Coherence_um=15.0))
    scene.camera = add(scene, "Camera", bpy.data.cameras.new("Camera"), (0.0, -2.5, 6.0))
    look_at(scene.camera)
    for k, location in enumerate([(3.0, 4.0, 8.0), (-6.0, 2.0, 7.0), (1.0, -7.0, 7.0)]):
        sun = add(scene, f"Sun {k}", bpy.data.lights.new(f"Sun {k}", "SUN"), location)
        sun.data.energy, sun.data.angle = 0.1, 0.009
        look_at(sun)
    scene.render.film_transparent = False
    scene.view_settings.view_transform = "Standard"
    scene.render.filepath = str(Path(sys.argv[1]).resolve())
    bpy.ops.render.render(write_still=True)


if __name__ == "__main__":
    main()
