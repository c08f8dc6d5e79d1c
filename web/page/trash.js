// Deletion with undo, and #/trash: what was deleted and can be restored.

import { get, post, query, send } from "./api.js";
import { h } from "./dom.js";
import { complain, confirmed, offer, tell } from "./feedback.js";
import { bytes, duration, moment } from "./format.js";

const DAY = 24 * 3600;

/**
 * Deletes a thing: into the trash, with a way back, or for good once that is confirmed. `changed` shows what is left.
 * @param {string} path Of the thing in the interface.
 * @param {{ id: string, name: string }} thing
 * @param {() => unknown} changed
 */
export async function discard(path, { id, name }, changed) {
  try {
    const { token, files, bytes: size, trash_days: days } = await get(`${path}/deletion`);
    if (!days && !(await confirmed(`Delete “${name}”?`, `${files} files, ${bytes(size)}. They are gone for good.`, "Delete"))) return;
    await send(`${path}${query({ token })}`, { method: "DELETE" });
    if (days) offer(`“${name}” is deleted. The trash keeps it for ${days} ${days === 1 ? "day" : "days"}.`, "Undo", () => restore(id, name, changed));
    else tell(`“${name}” is deleted.`);
    await changed();
  } catch (problem) {
    complain(problem);
  }
}

async function restore(id, name, changed) {
  try {
    await post(`/trash/${id}/restore`);
    tell(`“${name}” is restored.`);
    await changed();
  } catch (problem) {
    complain(problem);
  }
}

/**
 * Shows the trash until the signal fires.
 * @param {HTMLElement} main
 * @param {Visit} visit
 */
export async function trashPage(main, { signal }) {
  const list = h("ul", { class: "cards" });
  const said = h("p", { class: "soft", role: "status" });
  const empty = h("button", { type: "button", class: "danger", id: "empty-trash", onclick: () => destroy("/trash", "Empty the trash?", "Everything in it is", "Empty the trash") }, "Empty the trash");
  main.append(h("div", { class: "head" }, h("h1", { class: "grow" }, "Trash"), empty), h("div", { class: "stack" }, said, list));

  async function load() {
    /** @type {{ items: TrashItem[], days: number }} */
    const { items, days } = await get("/trash", { signal });
    list.replaceChildren(...items.map(card));
    empty.hidden = !items.length;
    const kept = days ? `Deleted sessions, uploads and results stay here for ${days} ${days === 1 ? "day" : "days"}, less if disk space runs short.` : "Deletions are at once: limits.trash_days is 0.";
    said.textContent = items.length ? kept : `The trash is empty. ${kept}`;
  }

  /** @param {TrashItem} item */
  function card(item) {
    return h("li", { class: "panel card plain", "data-deleted": item.id },
      h("div", { class: "about" },
        h("span", { class: "title" }, item.name),
        h("p", { class: "row soft" }, h("span", {}, { session: "Session", upload: "Upload", reconstruction: "Result", calibration: "Calibration" }[item.kind]), h("span", {}, `${item.files} files, ${bytes(item.bytes)}`),
          h("span", {}, `deleted ${moment(item.deleted)}`), h("span", {}, left(item.expires)))),
      h("div", { class: "row" },
        h("button", { type: "button", "aria-label": `Restore ${item.name}`, onclick: () => restore(item.id, item.name, load) }, "Restore"),
        h("button", { type: "button", class: "quiet danger", "aria-label": `Delete ${item.name} for good`, onclick: () => destroy(`/trash/${item.id}`, `Delete “${item.name}” for good?`, `${item.files} files, ${bytes(item.bytes)}, are`, "Delete for good") }, "Delete for good")));
  }

  async function destroy(path, question, what, action) {
    try {
      if (!(await confirmed(question, `${what} gone for good.`, action))) return;
      await send(path, { method: "DELETE" });
      await load();
    } catch (problem) {
      complain(problem);
    }
  }
  await load();
}

/** How long a thing can still be restored. */
function left(expires) {
  const seconds = expires - Date.now() / 1000;
  if (seconds <= 0) return "about to be deleted for good";
  const days = Math.round(seconds / DAY);
  return `${days > 1 ? `${days} days` : duration(Math.ceil(seconds))} left`;
}
