// A figure as a PDF of one page, made of the elements that figures have: rectangles, lines, paths, text and one picture.

/** Points of a PDF per unit of an SVG. */
const POINTS = 0.75;
/** Characters beyond Latin-1 that the standard encoding of PDF has, by their codes; the fonts have no σ. */
const SIGNS = { "–": "\x96", "—": "\x97", "−": "-", "σ": "SD", "⁻": "-", "\u202f": " " };

const number = (/** @type {number} */ value) => String(Number(value.toFixed(3)));
const attribute = (/** @type {Element} */ element, name, otherwise = 0) => Number(element.getAttribute(name) ?? otherwise);

/** Text as a PDF string of one byte per character; characters without a code become question marks. */
function literal(/** @type {string} */ text) {
  const latin = Array.from(text, (sign) => SIGNS[sign] ?? (sign.charCodeAt(0) < 256 ? sign : "?")).join("");
  return `(${latin.replace(/[\\()]/g, "\\$&")})`;
}

/** Red, green and blue from 0 to 1 of `#rrggbb` or `rgb(r,g,b)`. */
function colorOf(/** @type {string} */ css) {
  const values = css.startsWith("#") ? [1, 3, 5].map((k) => parseInt(css.slice(k, k + 2), 16)) : (css.match(/\d+/g) ?? []).map(Number);
  return values.map((v) => number(v / 255)).join(" ");
}

/** A path of absolute M, L, H, V and Z. */
function pathOf(/** @type {string} */ d) {
  let [x, y] = [0, 0];
  return [...d.matchAll(/([MLHVZ])([^MLHVZ]*)/g)].map(([, letter, rest]) => {
    const values = rest.trim().split(/[\s,]+/).map(Number);
    if (letter === "Z") return "h";
    if (letter === "H") x = values[0];
    else if (letter === "V") y = values[0];
    else [x, y] = values;
    return `${number(x)} ${number(y)} ${letter === "M" ? "m" : "l"}`;
  }).join("\n");
}

/** Operators that fill and stroke the path before them. */
function painted(/** @type {Element} */ element, /** @type {string} */ shape) {
  const [fill, stroke] = ["fill", "stroke"].map((name) => element.getAttribute(name) ?? "none");
  const lines = stroke === "none" ? "" : `${colorOf(stroke)} RG ${attribute(element, "stroke-width", 1)} w`;
  const areas = fill === "none" ? "" : `${colorOf(fill)} rg${element.hasAttribute("fill-opacity") ? " /faint gs" : ""}`;
  return `q ${areas} ${lines}\n${shape}\n${areas && lines ? "B" : areas ? "f" : "S"} Q`;
}

/** Text, which stands upright although the page's y axis points down. */
function written(/** @type {Element} */ element, /** @type {CanvasRenderingContext2D} */ pen) {
  const [text, size] = [element.textContent ?? "", attribute(element, "font-size", 13)];
  const bold = attribute(element, "font-weight", 400) > 500;
  pen.font = `${bold ? "bold " : ""}${size}px Helvetica, Arial, sans-serif`;
  const left = attribute(element, "x") - (element.getAttribute("text-anchor") === "middle" ? pen.measureText(text).width / 2 : 0);
  return `BT ${colorOf(element.getAttribute("fill") ?? "#000000")} rg /${bold ? "F2" : "F1"} ${size} Tf 1 0 0 -1 ${number(left)} ${number(attribute(element, "y"))} Tm ${literal(text)} Tj ET`;
}

/** Operators of an element; elements that draw nothing have none. */
function drawn(/** @type {Element} */ element, /** @type {CanvasRenderingContext2D} */ pen) {
  const at = (/** @type {string[]} */ ...names) => names.map((name) => number(attribute(element, name))).join(" ");
  switch (element.tagName) {
    case "rect": return painted(element, `${at("x", "y", "width", "height")} re`);
    case "line": return painted(element, `${at("x1", "y1")} m ${at("x2", "y2")} l`);
    case "path": {
      const shape = painted(element, pathOf(element.getAttribute("d") ?? ""));
      const clip = element.hasAttribute("clip-path") ? element.closest("svg")?.querySelector("clipPath rect") : null;
      return clip ? `q ${["x", "y", "width", "height"].map((name) => number(attribute(clip, name))).join(" ")} re W n\n${shape} Q` : shape;
    }
    case "text": return written(element, pen);
    case "image": {
      const [x, y, width, height] = ["x", "y", "width", "height"].map((name) => attribute(element, name));
      return `q ${number(width)} 0 0 ${number(-height)} ${number(x)} ${number(y + height)} cm /map Do Q`;
    }
    default: return "";
  }
}

/** Bytes in the format of the filter Flate. */
async function packed(/** @type {BlobPart} */ bytes) {
  const stream = new Blob([bytes]).stream().pipeThrough(new CompressionStream("deflate"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

const latin = (/** @type {string} */ text) => Uint8Array.from(text, (sign) => sign.charCodeAt(0));

/** Red, green and blue of a picture on white. */
function pixelsOf(/** @type {HTMLCanvasElement} */ picture) {
  const flat = document.createElement("canvas");
  [flat.width, flat.height] = [picture.width, picture.height];
  const pen = /** @type {CanvasRenderingContext2D} */ (flat.getContext("2d"));
  pen.fillStyle = "#ffffff";
  pen.fillRect(0, 0, flat.width, flat.height);
  pen.drawImage(picture, 0, 0);
  const { data } = pen.getImageData(0, 0, flat.width, flat.height);
  const rgb = new Uint8Array((data.length / 4) * 3);
  for (let from = 0, to = 0; from < data.length; from += 4, to += 3) rgb.set(data.subarray(from, from + 3), to);
  return rgb;
}

/**
 * The figure as a PDF.
 * @param {SVGElement} figure
 * @param {HTMLCanvasElement} picture The map in it, at full resolution.
 */
export async function pdfOf(figure, picture) {
  const [width, height] = ["width", "height"].map((name) => attribute(figure, name));
  const pen = /** @type {CanvasRenderingContext2D} */ (document.createElement("canvas").getContext("2d"));
  const operators = [...figure.children].map((element) => drawn(element, pen)).filter(Boolean);
  const content = await packed(latin(`${POINTS} 0 0 ${-POINTS} 0 ${number(POINTS * height)} cm\n${operators.join("\n")}\n`));
  const image = await packed(pixelsOf(picture));
  const title = literal(figure.querySelector("title")?.textContent ?? "");
  const font = (/** @type {string} */ name) => `<< /Type /Font /Subtype /Type1 /BaseFont /${name} /Encoding /WinAnsiEncoding >>`;
  const resources = "<< /Font << /F1 5 0 R /F2 6 0 R >> /XObject << /map 7 0 R >> /ExtGState << /faint << /ca 0.7 >> >> >>";
  /** @type {[string, Uint8Array?][]} */
  const objects = [
    ["<< /Type /Catalog /Pages 2 0 R >>"],
    ["<< /Type /Pages /Kids [3 0 R] /Count 1 >>"],
    [`<< /Type /Page /Parent 2 0 R /MediaBox [0 0 ${number(POINTS * width)} ${number(POINTS * height)}] /Contents 4 0 R /Resources ${resources} >>`],
    [`<< /Filter /FlateDecode /Length ${content.length} >>`, content],
    [font("Helvetica")], [font("Helvetica-Bold")],
    [`<< /Type /XObject /Subtype /Image /Width ${picture.width} /Height ${picture.height} /ColorSpace /DeviceRGB /BitsPerComponent 8 /Filter /FlateDecode /Length ${image.length} >>`, image],
    [`<< /Title ${title} /Creator (Nacre) >>`],
  ];
  return new Blob(file(objects), { type: "application/pdf" });
}

/** A file of objects, numbered from 1: the first is the catalogue, the last the description. */
function file(/** @type {[string, Uint8Array?][]} */ objects) {
  const parts = [latin("%PDF-1.4\n%\xe2\xe3\xcf\xd3\n")];
  let length = parts[0].length;
  const put = (/** @type {Uint8Array} */ part) => {
    parts.push(part);
    length += part.length;
  };
  const starts = objects.map(([dictionary, stream], k) => {
    const start = length;
    put(latin(`${k + 1} 0 obj\n${dictionary}\n`));
    if (stream) [latin("stream\n"), stream, latin("\nendstream\n")].forEach(put);
    put(latin("endobj\n"));
    return start;
  });
  const table = starts.map((start) => `${String(start).padStart(10, "0")} 00000 n \n`).join("");
  const start = length;
  put(latin(`xref\n0 ${objects.length + 1}\n0000000000 65535 f \n${table}trailer\n<< /Size ${objects.length + 1} /Root 1 0 R /Info ${objects.length} 0 R >>\nstartxref\n${start}\n%%EOF\n`));
  return parts;
}
