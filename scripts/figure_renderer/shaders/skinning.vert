uniform mat4 bones[19];
uniform mat4 view_projection;
uniform mat4 light_projection;
uniform vec4 cut;         // sleeve end, top's lower edge, waist, trouser end
uniform vec4 thickness;   // top, bottom, hair, shoes; metres
uniform vec4 landmarks;   // neck height / stature, head joint y, z in metres, head scale
in vec3 in_position; in vec3 in_normal; in ivec4 in_bone; in vec4 in_weight; in vec4 in_coord;
out vec3 rest; out vec4 coord; out vec3 world; out vec3 normal; out vec4 in_light; out vec2 uv;
void main() {
    vec4 c = in_coord;
    float arm = smoothstep(-0.01, 0.01, c.y);
    float top = mix(smoothstep(cut.y - 0.01, cut.y, c.z) * (1 - smoothstep(landmarks.x - 0.03, landmarks.x, c.z)),
                    1 - smoothstep(cut.x - 0.02, cut.x, c.x), arm);
    float bottom = (1 - arm) * (1 - smoothstep(cut.z - 0.01, cut.z, c.z))
                 * (1 - smoothstep(cut.w - 0.02, cut.w, c.w));
    vec3 q = (in_position - vec3(0, landmarks.yz)) / landmarks.w;
    float hair = smoothstep(0.0, 0.03, q.y) * smoothstep(-0.035, 0.02, max(q.y - 0.11, -q.z + 0.02));
    float shoe = (1 - arm) * smoothstep(0.98, 1.0, c.w);
    float swell = max(max(top * thickness.x, bottom * thickness.y * (0.6 + c.w)),
                      max(hair * thickness.z, shoe * thickness.w));
    vec4 p = vec4(in_position + in_normal * swell, 1);
    mat4 m = bones[in_bone.x] * in_weight.x + bones[in_bone.y] * in_weight.y
           + bones[in_bone.z] * in_weight.z + bones[in_bone.w] * in_weight.w;
    world = (m * p).xyz; normal = mat3(m) * in_normal; rest = in_position; coord = c; uv = vec2(0);
    in_light = light_projection * vec4(world, 1);
    gl_Position = view_projection * vec4(world, 1);
}
