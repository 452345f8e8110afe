uniform vec3 colour_a, colour_b; uniform vec2 pattern; uniform vec2 finish;  // gloss, metal
uniform int kind;  // 0 solid thing, 1 floor, 2 curtain, 3 skirt, 4 painted wall
uniform vec3 trim; uniform float planks;
void main() {
    vec3 n = normalize(normal), a; float gloss = finish.x, metal = finish.y;
    if (kind == 1) {
        if (planks > 0.0) {
            float row = floor(world.x / planks); vec2 w = vec2(fract(world.x / planks), fract(world.z / (planks * 14.0) + hash(vec3(row, 1, 2))));
            float tone = hash(vec3(row, floor(world.z / (planks * 14.0) + hash(vec3(row, 1, 2))), 3.0));
            float grain = noise(vec3(world.x * 90.0, world.z * 4.0, row));
            a = mix(colour_a, colour_b, 0.5 * tone + 0.4 * grain);
            float seam = smoothstep(0.0, 0.035, min(w.x, 1.0 - w.x)) * smoothstep(0.0, 0.004, min(w.y, 1.0 - w.y));
            a *= 0.45 + 0.55 * seam;
        } else a = cloth(colour_a, colour_b, pattern, world, world.xz) * (0.85 + 0.3 * noise(world * 2.0));
    } else if (kind == 2) {
        float fold = sin(world.x * 9.0 + 1.6 * noise(vec3(world.x * 1.5, world.y * 0.25, 0.0)));
        n = normalize(n + vec3(0.7 * cos(world.x * 9.0 + 1.6 * noise(vec3(world.x * 1.5, world.y * 0.25, 0.0))), 0.0, 0.0));
        a = mix(colour_b, colour_a, 0.5 + 0.5 * fold) * (0.95 + 0.1 * noise(world * 40.0));
        if (world.y > trim.x && world.y < trim.y) a *= 0.5;
    } else if (kind == 3) {
        a = cloth(colour_a, colour_b, pattern, vec3(uv * 2.0, 0.0), uv);
        if (uv.y > 0.93) { a = trim; gloss = 0.6; metal = 0.5; }
        if (uv.y > 0.86 && uv.y < 0.885) { a = trim; gloss = 0.6; metal = 0.5; }
        vec3 p = vec3(uv.x * 40.0, uv.y * 4.0, 1.0); n = normalize(n + 0.3 * (vec3(noise(p), 0.5, noise(p + 5.0)) - 0.5));
    } else if (kind == 4) a = cloth(colour_a, colour_b, pattern, world, world.xy) * (0.8 + 0.4 * noise(world * 1.3));
    else a = cloth(colour_a, colour_b, pattern, rest, uv);
    pixel = vec4(shade(a, n, gloss, metal), in_mask);
}
