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

type Point = [number, number];
