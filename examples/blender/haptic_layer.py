# mypy: ignore-errors
"""Blender add-on: import and export the haptic layer of a GLB file of hapscene as a colour attribute.

    hapscene convert desk.scene.json desk.glb --cut
    Blender: File > Import > Haptic layer; paint the attribute `haptics`; File > Export > Haptic layer
    hapscene convert desk.glb desk.scene.json

Each body becomes one mesh object. The attribute has the colour of a swatch at each corner of a face. On export a face
gets the swatch whose colour is nearest at most of its corners. The names and colours of the swatches are the custom
property `hapscene_swatches` of the Blender scene, shown in the sidebar of the 3D view, tab Haptics. A name that you add
there is found in the swatch library when hapscene reads the file.

Install it with Edit > Preferences > Add-ons > Install, or load it once with `blender --python haptic_layer.py`. It
needs Blender 3.4 or later and its glTF add-on, which is enabled by default.
"""

import json
import struct
from pathlib import Path

import bpy
import numpy as np
from bpy_extras.io_utils import ExportHelper, ImportHelper

bl_info = {
    "name": "Haptic layer of hapscene",
    "author": "hapscene contributors",
    "version": (1, 0, 0),
    "blender": (3, 4, 0),
    "location": "File > Import, File > Export, sidebar of the 3D view",
    "description": "Paint haptic swatches on meshes",
    "category": "Import-Export",
}

LAYER = "haptics"  # name of the colour attribute
SWATCHES = "hapscene_swatches"  # custom property of the Blender scene: sRGB colour (3) by name of swatch
SWATCH = "hapscene_swatch"  # custom properties that hapscene writes: docs/reference/file-formats.md
BODY, FINE, OVERLAY, SOURCE, ALBEDO = "hapscene_body", "fine", "hapscene_overlay", "source_material", "albedo_rgb"
PLAIN = "plain"
PLAIN_RGB = (0.72, 0.72, 0.72)  # where a file does not have the colour of plain faces
DISTINCT = 0.05  # least distance of the colours of two swatches: colours are the only mark of a swatch while painting


def linear(srgb):
    """Convert sRGB (…, 3) to the linear colours of attributes (…, 3)."""
    srgb = np.asarray(srgb, float)
    return np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)  # IEC 61966-2-1


def palette(context):
    """Return the sRGB colours (3) of all swatches by name."""
    return {name: list(colour) for name, colour in context.scene.get(SWATCHES, {}).items()}


def add_swatch(context, name, colour):
    """Add a swatch to the palette unless it is there; a colour that another swatch has is changed a little."""
    known, colour = palette(context), np.array(colour, float)
    if name not in known:
        step = 0
        while any(np.abs(colour - other).max() < DISTINCT for other in known.values()):
            colour[step % 3] = (colour[step % 3] + 0.37) % 1.0
            step += 1
        context.scene[SWATCHES] = known | {name: colour.tolist()}


# Import.


def swatches_of(path):
    """Return the extras of all swatches in a GLB file; Blender imports only materials that are in use."""
    content = Path(path).read_bytes()
    (size,) = struct.unpack_from("<I", content, 12)
    extras = [material.get("extras", {}) for material in json.loads(content[20 : 20 + size]).get("materials", [])]
    return [own for own in extras if SWATCH in own]


def keep_swatch(extras):
    """Keep the data of a swatch that no face has, in a material that Blender saves."""
    if not any(material.get(SWATCH) == extras[SWATCH] for material in bpy.data.materials):
        material = worn_material(extras[SWATCH], extras.get(ALBEDO, PLAIN_RGB))
        material.use_fake_user = True
        for key, value in extras.items():
            if key != SOURCE:
                material[key] = value


def worn_material(name, colour):
    """Return a new material with the colour of a swatch."""
    material = bpy.data.materials.new(name)
    material.use_nodes = True
    material.node_tree.nodes["Principled BSDF"].inputs["Base Color"].default_value = (*linear(colour), 1.0)
    give_swatch(material, name)
    return material


def give_swatch(material, name):
    """Give a material the data of a swatch, which another material of the file has; else its name."""
    for own in bpy.data.materials:
        if own.get(SWATCH) == name:
            for key in set(own.keys()) - {SOURCE}:
                material[key] = own[key]
            break
    material[SWATCH] = name


def import_layer(context, path):
    """Import a file; return a warning for each body that has finer paint than its faces."""
    before = set(bpy.data.objects)
    bpy.ops.import_scene.gltf(filepath=str(path))
    made = [item for item in bpy.data.objects if item not in before]
    for item in [item for item in made if item.type == "MESH" and OVERLAY in item.data]:
        made.remove(item)
        bpy.data.objects.remove(item)
    for extras in swatches_of(path):
        add_swatch(context, extras[SWATCH], extras.get(ALBEDO, PLAIN_RGB))
        keep_swatch(extras)
    add_swatch(context, PLAIN, PLAIN_RGB)
    warnings = []
    for body in [item for item in made if BODY in item]:
        pieces = [item for item in body.children if item.type == "MESH"]
        if pieces:
            show_layer(context, joined(context, pieces, body[BODY]))
        if FINE in body:  # it belongs to the faces of the file, which may now be painted otherwise
            del body[FINE]
            warnings.append(f"{body[BODY]}: paint is finer than faces; to see it, write the file with --cut")
    return warnings


def joined(context, pieces, name):
    """Join the pieces of a body, of which there is one for each swatch, to one object."""
    for piece in pieces:
        if piece.data.users > 1:  # another body has the same mesh
            piece.data = piece.data.copy()
    if len(pieces) > 1:
        with context.temp_override(active_object=pieces[0], object=pieces[0], selected_editable_objects=pieces):
            bpy.ops.object.join()
    pieces[0].name = pieces[0].data.name = f"{name}/{LAYER}"
    return pieces[0]


def show_layer(context, item):
    """Add the colour attribute, with the swatch of the material of each face."""
    mesh, known = item.data, palette(context)
    materials = [slot.material for slot in item.material_slots] or [None]
    names = [PLAIN if material is None else material.get(SWATCH, PLAIN) for material in materials]
    slot, count = (np.zeros(len(mesh.polygons), np.int32) for _ in range(2))
    mesh.polygons.foreach_get("material_index", slot)
    mesh.polygons.foreach_get("loop_total", count)
    colour = np.ones((len(names), 4), np.float32)
    colour[:, :3] = linear([known[name] for name in names])
    layer = mesh.color_attributes.new(LAYER, "FLOAT_COLOR", "CORNER")
    layer.data.foreach_set("color", np.repeat(colour[slot], count, axis=0).ravel())
    mesh.color_attributes.active_color = layer


# Export.


def export_layer(context, path):
    """Export all objects; meshes with the attribute get a material for each swatch in the file, not in Blender."""
    path, known = Path(path), palette(context)
    painted = [item for item in context.scene.objects if item.type == "MESH" and LAYER in item.data.attributes]
    originals, materials = [item.data for item in painted], set(bpy.data.materials)
    made = {}
    try:
        for item in painted:
            item.data = item.data.copy()
            store_layer(item.data, known, made)
        bpy.ops.export_scene.gltf(filepath=str(path), export_format="GLB", export_extras=True)
    finally:
        for item, original in zip(painted, originals, strict=True):
            if item.data is not original:
                copy, item.data = item.data, original
                bpy.data.meshes.remove(copy)
        for material in set(bpy.data.materials) - materials:
            bpy.data.materials.remove(material)


def painted_swatch(mesh, known):
    """Return for each face of a mesh the index of the swatch that most of its corners have."""
    layer = mesh.color_attributes[LAYER]
    colour = np.zeros((len(layer.data), 4), np.float32)
    layer.data.foreach_get("color", colour.ravel())
    corner = np.zeros(len(mesh.loops), np.int32)
    if layer.domain == "POINT":  # the attribute was converted
        mesh.loops.foreach_get("vertex_index", corner)
        colour = colour[corner]
    away = [np.square(colour[:, :3] - linear(own)).sum(axis=1) for own in known.values()]
    nearest = np.argmin(away, axis=0)
    size = np.zeros(len(mesh.polygons), np.int32)
    mesh.polygons.foreach_get("loop_total", size)
    votes = np.zeros((len(size), len(known)), np.int32)
    np.add.at(votes, (np.repeat(np.arange(len(size)), size), nearest), 1)
    return votes.argmax(axis=1)


def store_layer(mesh, known, made):
    """Replace the attribute of a mesh by materials with the names of swatches; `made` has those of other meshes."""
    names, sources = list(known), list(mesh.materials) or [None]
    swatch, slot = painted_swatch(mesh, known), np.zeros(len(mesh.polygons), np.int32)
    mesh.polygons.foreach_get("material_index", slot)
    mesh.materials.clear()
    for old, index in sorted(set(zip(slot.tolist(), swatch.tolist(), strict=True))):
        key = sources[old], names[index]
        if key not in made:
            made[key] = material_of(sources[old], names[index], known[names[index]])
        slot[(slot == old) & (swatch == index)] = -1 - len(mesh.materials)  # negative: not the old slot of another face
        mesh.materials.append(made[key])
    mesh.polygons.foreach_set("material_index", -1 - slot)
    mesh.color_attributes.remove(mesh.color_attributes[LAYER])


def material_of(source, name, colour):
    """Return a material with the look of another one, and the data of a swatch."""
    if source is not None and source.get(SWATCH) == name:
        return source
    if source is None or (SWATCH in source and SOURCE not in source):  # the face wears the look of its swatch
        worn = [own for own in bpy.data.materials if own.get(SWATCH) == name and SOURCE not in own]
        return worn[0] if worn else worn_material(name, colour)
    look = source.get(SOURCE, source.name)
    material = source.copy()
    material.name = f"{look}/{name}"
    for key in list(material.keys()):
        del material[key]
    give_swatch(material, name)
    material[SOURCE] = look
    return material


# User interface.


class ImportHapticLayer(bpy.types.Operator, ImportHelper):
    """Import a GLB file of hapscene, with its haptic layer as a colour attribute"""

    bl_idname = "import_scene.haptic_layer"
    bl_label = "Import haptic layer"
    bl_options = {"UNDO"}  # noqa: RUF012 - as Blender requires
    filter_glob: bpy.props.StringProperty(default="*.glb", options={"HIDDEN"})

    def execute(self, context):
        for text in import_layer(context, self.filepath):
            self.report({"WARNING"}, text)
        return {"FINISHED"}


class ExportHapticLayer(bpy.types.Operator, ExportHelper):
    """Export a GLB file, with the haptic layer as data that hapscene reads"""

    bl_idname = "export_scene.haptic_layer"
    bl_label = "Export haptic layer"
    filename_ext = ".glb"
    filter_glob: bpy.props.StringProperty(default="*.glb", options={"HIDDEN"})

    def execute(self, context):
        export_layer(context, self.filepath)
        return {"FINISHED"}


class ChooseSwatch(bpy.types.Operator):
    """Paint with the colour of this swatch"""

    bl_idname = "hapscene.choose_swatch"
    bl_label = "Choose swatch"
    name: bpy.props.StringProperty()

    def execute(self, context):
        tools = context.tool_settings
        tools.unified_paint_settings.color = palette(context)[self.name]
        if tools.vertex_paint.brush is not None:
            tools.vertex_paint.brush.color = palette(context)[self.name]
        return {"FINISHED"}


class AddSwatch(bpy.types.Operator):
    """Add a swatch of the library of hapscene, by its name"""

    bl_idname = "hapscene.add_swatch"
    bl_label = "Add swatch"
    name: bpy.props.StringProperty(name="Name")
    colour: bpy.props.FloatVectorProperty(name="Colour", subtype="COLOR_GAMMA", default=(0.8, 0.3, 0.1), min=0, max=1)

    def invoke(self, context, event):
        return context.window_manager.invoke_props_dialog(self)

    def execute(self, context):
        add_swatch(context, self.name, self.colour)
        return {"FINISHED"}


class SwatchPanel(bpy.types.Panel):
    bl_idname = "VIEW3D_PT_hapscene_swatches"
    bl_label = "Swatches"
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "Haptics"

    def draw(self, context):
        for name in palette(context):
            self.layout.operator(ChooseSwatch.bl_idname, text=name).name = name
        self.layout.operator(AddSwatch.bl_idname, icon="ADD")


CLASSES = (ImportHapticLayer, ExportHapticLayer, ChooseSwatch, AddSwatch, SwatchPanel)


def import_entry(menu, context):
    menu.layout.operator(ImportHapticLayer.bl_idname, text="Haptic layer (.glb)")


def export_entry(menu, context):
    menu.layout.operator(ExportHapticLayer.bl_idname, text="Haptic layer (.glb)")


def register():
    for made in CLASSES:
        bpy.utils.register_class(made)
    bpy.types.TOPBAR_MT_file_import.append(import_entry)
    bpy.types.TOPBAR_MT_file_export.append(export_entry)


def unregister():
    bpy.types.TOPBAR_MT_file_import.remove(import_entry)
    bpy.types.TOPBAR_MT_file_export.remove(export_entry)
    for made in CLASSES:
        bpy.utils.unregister_class(made)


if __name__ == "__main__":
    register()
