// Files that describe photographs, found among them: frames.json and geometry.json; and folders that are dropped.

/** Operations for each kind of set. */
const OPERATIONS = { polarization: "polarization", division_of_focal_plane: "polarization", exposures: "hdr", flash: "flash", spots: "spots" };

/**
 * Reads the descriptions among the files; all other files are `photographs`.
 * @param {File[]} files
 */
export async function describedBy(files) {
  const found = { photographs: /** @type {File[]} */ ([]), frames: /** @type {any} */ (null), geometry: /** @type {any} */ (null), problems: /** @type {string[]} */ ([]) };
  for (const file of files) {
    const name = /** @type {"frames" | "geometry" | null} */ ({ "frames.json": "frames", "geometry.json": "geometry" }[file.name] ?? null);
    // A description in a subfolder belongs to the photographs there.
    if (!name || (file.webkitRelativePath ?? "").split("/").length > 2) {
      found.photographs.push(file);
      continue;
    }
    try {
      found[name] = JSON.parse(await file.text());
    } catch {
      found.problems.push(`${file.name} is no JSON`);
    }
  }
  return found;
}

/** The operation that a set of photographs is for; empty where it does not say. */
export function operationOf(/** @type {any} */ frames) {
  // One flash at one place shows exposures of one view.
  const placed = (frames?.frames ?? []).some((frame) => frame.light_mm);
  return frames?.kind === "flash" && !placed ? "hdr" : OPERATIONS[frames?.kind] ?? "";
}

/**
 * A description whose files are named without folders, as an upload stores them.
 * @param {any} frames
 */
export function flattened(frames) {
  const bare = (name) => (typeof name === "string" ? name.slice(name.lastIndexOf("/") + 1) : name);
  return { ...frames, ...(frames.dark && { dark: bare(frames.dark) }),
    frames: (frames.frames ?? []).map((frame) => ({ ...frame, file: bare(frame.file), ...(frame.dark && { dark: bare(frame.dark) }) })) };
}

/**
 * Files of a drop and the name of its folder, if one was dropped. Folders within it are left out.
 * @param {DataTransfer} transfer
 */
export async function dropped(transfer) {
  const entries = /** @type {FileSystemEntry[]} */ ([...transfer.items].map((item) => item.webkitGetAsEntry()).filter((entry) => entry !== null));
  const files = [...transfer.files];
  const folders = /** @type {FileSystemDirectoryEntry[]} */ (entries.filter((entry) => entry.isDirectory));
  if (folders.length === 0) return { files, folder: "" };
  const inside = await Promise.all(folders.map(filesIn));
  return { files: [...files.filter((file) => !folders.some((folder) => folder.name === file.name)), ...inside.flat()], folder: folders[0].name };
}

/** @param {FileSystemDirectoryEntry} folder */
async function filesIn(folder) {
  const reader = folder.createReader();
  /** @type {File[]} */
  const files = [];
  // A reader gives a hundred entries at a time.
  for (;;) {
    /** @type {FileSystemEntry[]} */
    const some = await new Promise((resolve, reject) => reader.readEntries(resolve, reject));
    if (some.length === 0) return files;
    for (const entry of some) {
      if (entry.isFile) files.push(await new Promise((resolve, reject) => /** @type {FileSystemFileEntry} */ (entry).file(resolve, reject)));
    }
  }
}
