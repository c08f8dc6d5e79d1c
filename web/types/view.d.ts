// Types of the viewer. Nothing of it is served.

/** Uniforms of the shaders by name, each a list of four numbers or several. */
type Uniforms = Record<string, number[][]>;

interface Texture {
    name: string;
    width: number;
    height: number;
    channels: number;
    values: Float32Array;
}

/** What the service sends to be shown under a light. */
interface View {
    uniforms: Uniforms;
    textures: Texture[];
}

/** A stage of the shaders as the build translates it. */
interface Shader {
    source: string;
    block: string;
    members: [string, number][];
    textures: Record<string, string>;
}

/** A linked stage of the shaders. */
interface Program {
    program: WebGLProgram;
    members: [string, number][];
    places: [string, WebGLUniformLocation | null][];
    buffer: WebGLBuffer | null;
}

/** The shaders for WebGPU: constants of a scene go before the source; textures with their bindings. */
interface DirectShader {
    source: string;
    members: [string, number][];
    textures: [string, number][];
}

/** What draws a view on a canvas, by whichever way. */
interface AnyPainter {
    uniforms: Uniforms;
    targets: readonly unknown[];
    count: number;
    load(view: View): void;
    set(values: Uniforms): void;
    add(width: number, height: number, samples: number): void;
    show(exposure: number, overlay: boolean): void;
    done(): Promise<void>;
    pixels(x?: number, y?: number, width?: number, height?: number): Promise<Float32Array>;
    close(): void;
}

/** A way to draw, and why it is not the better one. */
interface Card {
    way: "WebGPU" | "WebGL2";
    why: string;
    painter(canvas: HTMLCanvasElement): AnyPainter;
    /** Tells a sentence once the card is lost. */
    lost(say: (sentence: string) => void): void;
    close(): void;
}

type Point = [number, number];
