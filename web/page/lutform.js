// The options of a lookup table, with the photograph of an extended light, which is an upload of its own.

import { send } from "./api.js";
import { field, h, number } from "./dom.js";
import { operationForm } from "./operationform.js";
import { picker } from "./picker.js";

/**
 * The form, as an earlier table left it; `inputs()` uploads the photograph of a light and says what stands for it in the request.
 * @param {Record<string, any>} [given]
 * @param {Partial<LightUpload> | null} [earlier]
 */
export function lutForm(given = {}, earlier = null) {
  const form = operationForm("lut", given, { without: ["light", "center"] });
  const center = picker("lut-center", ["zero order: the mirror image of the light"], { given: Array.isArray(given.center) ? [given.center] : null });
  const shape = h("input", { type: "file", id: "lut-light", multiple: true, accept: ".png,.tif,.tiff,.jpg,.jpeg,.exr" });
  const scale = number({ id: "lut-light-scale", value: earlier?.scale ?? "", min: 0 });
  const element = h("div", { class: "stack" }, form.element,
    h("fieldset", {}, h("legend", {}, "Zero order"), h("p", { class: "soft" }, "Empty: the brightest lobe. Pick it if another lobe is as bright."), center.element),
    h("div", { class: "fields" },
    field("Photograph of an extended light", shape, { hint: earlier ? "Empty: the same light as before" : "Its mirror image, or exposures of that. Empty: a point source" }),
    field("Half vector per pixel of the light", scale, { hint: "Empty: that of the pattern" })));
  return {
    element,
    /** The photograph to pick in. */
    show: center.show,
    options: () => ({ ...form.options(), ...(center.points().length && { center: center.points()[0] }) }),
    inputs: async (/** @type {AbortSignal} */ signal) => {
      const chosen = shape.files ?? [];
      if (chosen.length === 0 && !earlier) return {};
      const light = { ...earlier };
      if (chosen.length > 0) {
        const body = new FormData();
        body.append("kind", "photographs");
        for (const file of chosen) body.append("file", file, file.name);
        light.upload = (await (await send("/uploads", { method: "POST", body, signal })).json()).id;
        delete light.center;
      }
      light.scale = Number.isFinite(scale.valueAsNumber) ? scale.valueAsNumber : null;
      return { light };
    },
  };
}
