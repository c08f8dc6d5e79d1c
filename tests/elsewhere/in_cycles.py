"""The shader of `nacre.osl` in Blender's Cycles against `nacre render`: five views and a white sky.

  in_cycles.py FOLDER [VIEW ...]

Prints `name | measured | bound` per agreement; exits with 1 if a bound is missed. Needs NACRE_BIN.
"""

from __future__ import annotations

import math
import os
import sys
from pathlib import Path
from typing import Any

import bpy
import numpy as np

import colors
import nacre
import views
from nacre.osl import blender
from views import View

DELTA_E, FURNACE = 2.0, 0.01

# Samples per pixel under lamps, in the room and under a white sky.
SAMPLES = {None: 256, "sky.exr": 1024, "white.exr": 64}

# Cycles prints its progress to standard output.
lines = os.fdopen(os.dup(1), "w", buffering=1)
os.dup2(os.open(os.devnull, os.O_WRONLY), 1)


def options(view: View) -> dict[str, Any]:
    """Sockets of the shader for a view."""
    own, found = view.material, {}
    profile = own["profile"]
    if isinstance(profile, dict):
        found["Duty"] = profile["rectangular"]["duty"]
        profile = "rectangular"
    found |= {"Profile": profile, "Depth_um": own["depth_um"], "Coherence_um": own["coherence_um"]}
    for key, socket in (("period_um", "Period_um"), ("orientation_deg", "Orientation_deg")):
        if key in own:
            found[socket] = own[key]
    return found


def add_sky(scene: Any, file: Path) -> None:
    """An environment whose zenith is y and whose middle column is z."""
    tree = scene.world.node_tree
    place, parts, turned, texture = (
        tree.nodes.new(f"ShaderNode{kind}") for kind in ("TexCoord", "SeparateXYZ", "CombineXYZ", "TexEnvironment")
    )
    texture.image = bpy.data.images.load(str(file.resolve()))
    texture.image.colorspace_settings.name = "Non-Color"
    tree.links.new(place.outputs["Generated"], parts.inputs[0])
    for to, source in enumerate("ZXY"):
        tree.links.new(parts.outputs[source], turned.inputs[to])
    tree.links.new(turned.outputs[0], texture.inputs["Vector"])
    background = tree.nodes["Background"]
    tree.links.new(texture.outputs["Color"], background.inputs["Color"])
    background.inputs["Strength"].default_value = 1.0


def picture(view: View, folder: Path, part: int) -> np.ndarray:
    """Linear sRGB of Cycles, for a part of the shader."""
    scene = blender.empty_scene(views.PIXELS, views.PIXELS, SAMPLES[view.sky])
    scene.cycles.pixel_filter_type, scene.cycles.max_bounces = "BOX", 1
    if view.sphere:
        bpy.ops.mesh.primitive_uv_sphere_add(radius=view.size / 2, segments=256, ring_count=128)
        bpy.ops.object.shade_smooth()
        bpy.context.object.rotation_euler = (-math.pi / 2, 0, 0)
    else:
        bpy.ops.mesh.primitive_plane_add(size=view.size)
    maps = folder / view.material["maps"] if "maps" in view.material else None
    sample = bpy.context.object
    sample.data.materials.append(blender.material("Sample", maps, Part=part, **options(view)))
    scene.camera = blender.add(scene, "Camera", bpy.data.cameras.new("Camera"), view.camera)
    lens = scene.camera.data
    lens.sensor_fit, lens.angle_y = "VERTICAL", math.radians(view.fov_deg)
    lens.clip_end = 1e4
    blender.look_at(scene.camera)
    if view.point:
        lamp = blender.add(scene, "Point", bpy.data.lights.new("Point", "POINT"), view.point)
        # Illuminance 1 at the origin.
        lamp.data.energy, lamp.data.shadow_soft_size = 4 * math.pi * float(np.dot(view.point, view.point)), 0.0
    for k, direction in enumerate(view.suns):
        sun = blender.add(scene, f"Sun {k}", bpy.data.lights.new(f"Sun {k}", "SUN"), direction)
        sun.data.energy, sun.data.angle = 1.0, 0.0
        blender.look_at(sun)
    if view.sky:
        add_sky(scene, folder / view.sky)
    out = folder / f"{view.name}-cycles.exr"
    image = scene.render.image_settings
    image.file_format, image.color_depth, image.exr_codec = "OPEN_EXR", "32", "NONE"
    scene.render.filepath = str(out.resolve())
    bpy.ops.render.render(write_still=True)
    maps = nacre.read_maps(out)
    return np.stack([maps[c] for c in "RGB"], axis=-1).astype(np.float64)


def main() -> None:
    folder, chosen = Path(sys.argv[1]), sys.argv[2:]
    if not (folder / "lut.exr").exists():
        views.write_inputs(folder)
    missed = False

    def report(name: str, measured: float, bound: float | None, unit: str = "") -> None:
        nonlocal missed
        missed |= bound is not None and not measured <= bound
        limit = "none" if bound is None else f"{bound:g}{unit}"
        print(f"{name} | {measured:.3g}{unit} | {limit}", file=lines)

    gratings = [view for view in views.views() if view.material["type"] == "grating"]
    for view in [v for v in gratings if not chosen or v.name in chosen]:
        truth = views.by_nacre(view, folder)
        exact = picture(view, folder, 1) - picture(view, folder, -1)
        single = picture(view, folder, 0)
        colors.write_png(folder / f"{view.name}-cycles.png", [truth, exact, single])
        report(f"Cycles, {view.name}: mean ΔE2000 of the difference of two parts", colors.difference(truth, exact).mean(), DELTA_E)
        report(f"Cycles, {view.name}: mean ΔE2000 of a single picture", colors.difference(truth, single).mean(), None)
    for view in [v for v in views.furnaces() if not chosen or v.name in chosen]:
        lit = views.by_nacre(view, folder).min(-1) > 0.995
        exact = picture(view, folder, 1) - picture(view, folder, -1)
        for name, found in (("two parts", exact), ("a single picture", picture(view, folder, 0))):
            off = 100 * abs(found[lit].mean() - 1)
            report(f"Cycles, {view.name}: reflectance, {name}", float(off), 100 * FURNACE, " %")
    sys.exit(missed)


if __name__ == "__main__":
    main()
