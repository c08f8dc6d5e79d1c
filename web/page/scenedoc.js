// A scene under edit, as TOML and JSON, with the states for undo and redo. The service checks each state.

import { get, post } from "./api.js";
import { settle } from "./dom.js";

/** Most states that can be undone. */
const KEPT = 200;

/**
 * @typedef {{ scene: any, toml: string | null, problem: string | null, hints: string[] }} SceneState
 * `toml` is null until the service has converted an edit.
 */

/**
 * A document on the scene of an upload. `changed(own)` is called after every change; `own` is the part that made it, if
 * one did. `checked()` is called when the service has answered.
 * @param {string} upload
 * @param {{ changed: (own?: unknown) => void, checked: () => void, failed: (problem: Error) => void, signal: AbortSignal }} on
 */
export function sceneDocument(upload, on) {
  /** @type {SceneState[]} */
  const past = [];
  /** @type {SceneState[]} */
  const future = [];
  /** @type {SceneState} */
  let now = { scene: null, toml: null, problem: null, hints: [] };
  let asked = 0;
  const self = {
    upload, files: /** @type {string[]} */ ([]), name: "",
    now: () => now,
    canUndo: () => past.length > 0,
    canRedo: () => future.length > 0,
    load, edit, editText, undo, redo, check, rebase,
  };

  /** Reads the scene of the upload; `text` is an edited one of it. */
  async function load(text) {
    const path = `/uploads/${self.upload}/scene`;
    const answer = text ? await post(path, { toml: text }, { signal: on.signal }) : await get(path, { signal: on.signal });
    take(answer);
    on.changed();
    on.checked();
  }

  function take({ name, toml, scene, problem, hints, files }) {
    now = { scene: scene ?? now.scene, toml, problem, hints };
    Object.assign(self, { files, name });
  }

  function push(next) {
    past.push(now);
    if (past.length > KEPT) past.shift();
    future.length = 0;
    now = next;
  }

  /**
   * Changes the scene: `change` gets a copy of it.
   * @param {(scene: any) => void} change
   * @param {unknown} [own]
   */
  function edit(change, own) {
    const scene = structuredClone(now.scene);
    change(scene);
    if (JSON.stringify(scene) === JSON.stringify(now.scene)) return;
    push({ scene, toml: null, problem: null, hints: [] });
    on.changed(own);
    settled();
  }

  const settled = settle(150, () => check().catch(on.failed));

  /** Asks the service for the text and the problems of the present state. */
  async function check() {
    const mine = ++asked;
    const state = now;
    if (state.toml === null) {
      const answer = await post(`/uploads/${self.upload}/scene`, { scene: state.scene }, { signal: on.signal });
      Object.assign(state, { toml: answer.toml, problem: answer.problem, hints: answer.hints });
    }
    if (mine === asked && state === now) on.checked();
  }

  /** Takes a text; one that is no TOML is refused with the reason. */
  async function editText(toml) {
    if (toml === now.toml) return null;
    const answer = await post(`/uploads/${self.upload}/scene`, { toml }, { signal: on.signal });
    if (!answer.scene?.camera) return answer.problem ?? "camera: missing";
    push(now);
    take(answer);
    on.changed();
    on.checked();
    return null;
  }

  function undo() {
    const before = past.pop();
    if (before) step(before, future);
  }

  function redo() {
    const after = future.pop();
    if (after) step(after, past);
  }

  function step(to, left) {
    left.push(now);
    now = to;
    on.changed();
    check().catch(on.failed);
  }

  /** Goes on with another upload, which has the same files and more. */
  function rebase(next, files) {
    Object.assign(self, { upload: next, files });
    // A file that was missing may be among the new ones, so scenes with problems are checked again.
    for (const state of [now, ...past, ...future]) state.toml = state.problem ? null : state.toml;
  }
  return self;
}
