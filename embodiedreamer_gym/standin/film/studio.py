"""The script that Blender runs: a scene as JSON on its standard input, the light of each frame on its standard output.

The poses of further frames may follow the scene, a line of JSON each, for as long as somebody writes them.

`blender.py` starts it in a Python that has bpy (GPL), which is why nothing of this package is imported here. A frame is
float32 red, green, blue and alpha, scene-linear, the bottom row first.
"""

from __future__ import annotations

import array
import importlib
import itertools
import json
import os
import sys
import tempfile
from pathlib import Path
from typing import Any

pictures = os.fdopen(os.dup(1), "wb")
os.dup2(os.open(os.devnull, os.O_WRONLY), 1)  # Blender talks there, even while it is loaded
bpy: Any = importlib.import_module("bpy")


def main() -> None:
    """Build the scene, then render each of its frames, and those that follow."""
    scene = json.loads(sys.stdin.readline())
    holders = build(scene)
    with tempfile.TemporaryDirectory() as folder:
        for poses in itertools.chain(scene["frames"], map(json.loads, iter(sys.stdin.readline, ""))):
            for holder, pose in zip(holders, poses, strict=True):
                holder.matrix_world = matrix(pose)
            pictures.write(shoot(Path(folder) / "light.exr"))
            pictures.flush()


def build(scene: dict[str, Any]) -> list[Any]:
    """Make everything of a scene; the moving bodies, in the order of the frames' poses."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    render_settings(scene)
    make_camera(scene["camera"])
    make_world(scene["sky"])
    for lamp in scene["lamps"]:
        make_lamp(lamp)
    paints = {name: make_paint(name, nodes) for name, nodes in scene["paints"].items()}
    holders = {name: bpy.data.objects.new(name, None) for name in scene["moving"]}
    for holder in holders.values():
        bpy.context.collection.objects.link(holder)
    for part in scene["parts"]:
        make_part(part, paints, holders)
    if scene["classes"]:
        show_classes()
    return [holders[name] for name in scene["moving"]]


def render_settings(scene: dict[str, Any]) -> None:
    """Cycles on one thread: neither time nor result depends on the machine."""
    render, cycles = bpy.context.scene.render, bpy.context.scene.cycles
    render.engine = "CYCLES"
    render.resolution_x, render.resolution_y = scene["size"]
    render.resolution_percentage = 100
    render.threads_mode, render.threads = "FIXED", 1
    render.use_persistent_data = True
    render.image_settings.file_format = "OPEN_EXR"
    render.image_settings.color_depth = "32"
    render.image_settings.exr_codec = "NONE"
    cycles.device = "CPU"
    cycles.samples, cycles.seed = scene["samples"], scene["seed"]
    cycles.use_adaptive_sampling = False
    cycles.filter_width = 1.2  # pixels; Blender's 1.5 blurs small pictures
    cycles.use_animated_seed = False
    cycles.use_denoising, cycles.denoiser = not scene["classes"], "OPENIMAGEDENOISE"
    cycles.denoising_input_passes, cycles.denoising_prefilter = "RGB_ALBEDO_NORMAL", "FAST"
    cycles.max_bounces, cycles.diffuse_bounces, cycles.glossy_bounces = 4, 3, 2
    cycles.caustics_reflective = cycles.caustics_refractive = False
    cycles.blur_glossy, cycles.sample_clamp_indirect = 1.0, 4.0
    cycles.debug_use_spatial_splits = False


def make_camera(spec: dict[str, Any]) -> None:
    """A pinhole; `blender.py` says how its numbers follow from fx, fy, cx, cy."""
    lens = bpy.data.cameras.new("camera")
    lens.sensor_fit, lens.sensor_width, lens.lens = "HORIZONTAL", 36.0, spec["lens"]
    lens.shift_x, lens.shift_y = spec["shift"]
    lens.clip_start, lens.clip_end = spec["near"], spec["far"]
    render = bpy.context.scene.render
    render.pixel_aspect_x, render.pixel_aspect_y = spec["aspect"]
    made = bpy.data.objects.new("camera", lens)
    bpy.context.collection.objects.link(made)
    made.matrix_world = matrix(spec["pose"])
    bpy.context.scene.camera = made


def make_world(sky: dict[str, Any]) -> None:
    """Light from everywhere that is not covered."""
    world = bpy.data.worlds.new("sky")
    bpy.context.scene.world = world
    enable_nodes(world)
    background = next(node for node in world.node_tree.nodes if node.type == "BACKGROUND")
    background.inputs["Color"].default_value = (*sky["colour"], 1.0)
    background.inputs["Strength"].default_value = sky["strength"]


def make_lamp(lamp: dict[str, Any]) -> None:
    """A rectangle that shines along minus its z axis."""
    light = bpy.data.lights.new("lamp", "AREA")
    light.shape, (light.size, light.size_y) = "RECTANGLE", lamp["size"]
    light.energy, light.color = lamp["power"], lamp["colour"]
    made = bpy.data.objects.new("lamp", light)
    bpy.context.collection.objects.link(made)
    made.matrix_world = matrix(lamp["pose"])


def make_part(part: dict[str, Any], paints: dict[str, Any], holders: dict[str, Any]) -> None:
    """A closed shape, round where its faces meet at small angles, its edges rounded off."""
    mesh = bpy.data.meshes.new(part["paint"])
    mesh.from_pydata(part["points"], [], part["faces"])
    mesh.materials.append(paints[part["paint"]])
    made = bpy.data.objects.new(part["paint"], mesh)
    bpy.context.collection.objects.link(made)
    made.pass_index = part["number"]
    if part["body"] is not None:
        made.parent = holders[part["body"]]
    if part["rounding"] > 0.0:
        bevel = made.modifiers.new("rounding", "BEVEL")
        bevel.width, bevel.segments, bevel.limit_method, bevel.angle_limit = part["rounding"], 2, "ANGLE", 0.6
        made.data = bpy.data.meshes.new_from_object(made.evaluated_get(bpy.context.evaluated_depsgraph_get()))
        made.modifiers.clear()
    made.data.shade_smooth()
    made.data.set_sharp_from_angle(angle=0.9)


def make_paint(name: str, nodes: list[Any]) -> Any:
    """A material of nodes [type, settings, inputs]; an input is a value or ["@", node, output]; the last one shines."""
    paint = bpy.data.materials.new(name)
    enable_nodes(paint)
    tree = paint.node_tree
    tree.nodes.clear()
    made = []
    for kind, settings, inputs in nodes:
        node = tree.nodes.new(kind)
        for key, value in settings.items():
            if key == "ramp":
                fill_ramp(node.color_ramp, value)
            else:
                setattr(node, key, value)
        for key, value in inputs.items():
            socket = node.inputs[int(key) if key.isdigit() else key]
            if isinstance(value, list) and value[0] == "@":
                output = value[2]
                tree.links.new(made[value[1]].outputs[output], socket)
            else:
                socket.default_value = value
        made.append(node)
    surface = tree.nodes.new("ShaderNodeOutputMaterial")
    tree.links.new(made[-1].outputs[0], surface.inputs["Surface"])
    return paint


def fill_ramp(ramp: Any, stops: list[Any]) -> None:
    """Colours at positions 0..1; "constant" first where they do not blend."""
    if stops[0] == "constant":
        ramp.interpolation, stops = "CONSTANT", stops[1:]
    while len(ramp.elements) < len(stops):
        ramp.elements.new(1.0)
    for element, (position, colour) in zip(ramp.elements, stops, strict=True):
        element.position, element.color = position, (*colour, 1.0)


def show_classes() -> None:
    """Make every pixel show the class number of what lies behind its middle."""
    nodes = [["ShaderNodeObjectInfo", {}, {}], ["ShaderNodeEmission", {}, {"Strength": ["@", 0, "Object Index"]}]]
    layer, scene = bpy.context.view_layer, bpy.context.scene
    layer.material_override = make_paint("classes", nodes)
    scene.cycles.samples, scene.cycles.max_bounces = 1, 0
    scene.cycles.pixel_filter_type, scene.cycles.filter_width = "BOX", 0.01


def enable_nodes(block: Any) -> None:
    """Materials and worlds have nodes anyway from Blender 5 on, and setting it is deprecated there."""
    if block.node_tree is None:
        block.use_nodes = True


def matrix(rows: list[list[float]]) -> Any:
    """A pose as Blender takes it."""
    return importlib.import_module("mathutils").Matrix(rows)


def shoot(path: Path) -> bytes:
    """Render, and read what was rendered."""
    bpy.context.scene.render.filepath = str(path)
    bpy.ops.render.render(write_still=True)
    picture = bpy.data.images.load(str(path))
    picture.colorspace_settings.name = "Non-Color"
    values = array.array("f", bytes(4 * len(picture.pixels)))
    picture.pixels.foreach_get(values)
    bpy.data.images.remove(picture)
    path.unlink()
    return values.tobytes()


if __name__ == "__main__":
    main()
