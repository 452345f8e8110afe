uniform mat4 view_projection;
uniform mat4 light_projection;
in vec3 in_position; in vec3 in_normal; in vec2 in_uv;
out vec3 rest; out vec4 coord; out vec3 world; out vec3 normal; out vec4 in_light; out vec2 uv;
void main() {
    world = in_position; normal = in_normal; rest = in_position; coord = vec4(0); uv = in_uv;
    in_light = light_projection * vec4(world, 1);
    gl_Position = view_projection * vec4(world, 1);
}
