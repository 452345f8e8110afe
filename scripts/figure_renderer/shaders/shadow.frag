in vec3 rest; in vec4 coord; in vec3 world; in vec3 normal; in vec4 in_light; in vec2 uv;
void main() {}
