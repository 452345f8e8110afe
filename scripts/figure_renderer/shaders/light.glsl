// Light, shadow and cloth: what the fragment shaders of body and surfaces share.
in vec3 rest; in vec4 coord; in vec3 world; in vec3 normal; in vec4 in_light; in vec2 uv;
uniform vec3 eye; uniform vec3 to_light; uniform vec3 light_colour; uniform vec3 sky; uniform vec3 ground;
uniform vec3 fill; uniform sampler2DShadow shadow_map; uniform float texel; uniform int soft; uniform float in_mask;
uniform vec4 pool;  // centre x, z, radius and strength of the pool of light
out vec4 pixel;

float hash(vec3 p) { p = fract(p * 0.3183099 + 0.1); p *= 17.0; return fract(p.x * p.y * p.z * (p.x + p.y + p.z)); }
float noise(vec3 x) {
    vec3 i = floor(x), f = fract(x); f = f * f * (3.0 - 2.0 * f);
    return mix(mix(mix(hash(i), hash(i + vec3(1,0,0)), f.x), mix(hash(i + vec3(0,1,0)), hash(i + vec3(1,1,0)), f.x), f.y),
               mix(mix(hash(i + vec3(0,0,1)), hash(i + vec3(1,0,1)), f.x), mix(hash(i + vec3(0,1,1)), hash(i + vec3(1,1,1)), f.x), f.y), f.z);
}
// A woven or painted surface of two colours. kind: 0 plain, 1 stripes, 2 checks, 3 blotches, 4 dots, 5 bands.
vec3 cloth(vec3 a, vec3 b, vec2 pattern, vec3 p, vec2 flat_p) {
    float s = pattern.y; vec2 g = flat_p * s; float t = 0.0;
    int kind = int(pattern.x + 0.5);
    if (kind == 1) t = smoothstep(-0.1, 0.1, sin(g.x * 6.2832));
    else if (kind == 2) t = 0.5 * step(0.5, fract(g.x)) + 0.5 * step(0.5, fract(g.y));
    else if (kind == 3) t = smoothstep(0.42, 0.58, noise(p * s * 1.3));
    else if (kind == 4) t = 1.0 - smoothstep(0.25, 0.32, length(fract(g) - 0.5));
    else if (kind == 5) t = smoothstep(-0.1, 0.1, sin(g.y * 6.2832));
    return mix(a, b, t) * (0.9 + 0.2 * noise(p * 60.0));
}
float lit(float slope) {
    vec3 q = in_light.xyz / in_light.w * 0.5 + 0.5;
    if (any(lessThan(q, vec3(0))) || any(greaterThan(q, vec3(1)))) return 1.0;
    float sum = 0.0, bias = 0.0012 + 0.003 * (1.0 - slope);
    if (soft == 0) return texture(shadow_map, vec3(q.xy, q.z - 2.0 * bias));
    for (int i = -1; i <= 1; ++i) for (int j = -1; j <= 1; ++j)
        sum += texture(shadow_map, vec3(q.xy + vec2(i, j) * texel, q.z - bias));
    return sum / 9.0;
}
vec3 shade(vec3 albedo, vec3 n, float gloss, float metal) {
    vec3 v = normalize(eye - world); if (dot(n, v) < 0.0) n = -n;
    float slope = max(dot(n, to_light), 0.0);
    float shadow = lit(slope);
    float spot = mix(1.0, 1.0 - smoothstep(pool.z * 0.55, pool.z, length(world.xz - pool.xy)), pool.w);
    vec3 ambient = mix(ground, sky, 0.5 + 0.5 * n.y) * (0.55 + 0.45 * spot);
    vec3 h = normalize(to_light + v);
    float power = mix(8.0, 60.0, gloss);
    vec3 shine = mix(vec3(0.04), albedo, metal) * pow(max(dot(n, h), 0.0), power) * (power + 8.0) / 12.0;
    float rim = pow(1.0 - max(dot(n, v), 0.0), 3.0);
    vec3 c = albedo * (1.0 - 0.6 * metal) * (ambient + light_colour * slope * shadow * spot + fill * max(dot(n, v), 0.0))
           + light_colour * shine * gloss * slope * shadow * spot + 0.35 * rim * fill * albedo;
    return pow(c / (1.0 + 0.25 * c), vec3(1.0 / 2.2));
}
