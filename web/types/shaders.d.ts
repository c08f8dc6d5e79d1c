// The script that the build makes of the shaders.
declare module "*/shaders.js" {
    export const VERTEX: string;
    export const LIGHT: Shader;
    export const DISPLAY: Shader;
}
