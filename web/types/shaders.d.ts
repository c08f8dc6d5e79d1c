// The scripts that the build makes of the shaders.
declare module "*/shaders.js" {
    export const VERTEX: string;
    export const LIGHT: Shader;
    export const DISPLAY: Shader;
}
declare module "*/wgsl.js" {
    export const LIGHT: DirectShader;
    export const DISPLAY: DirectShader;
}
