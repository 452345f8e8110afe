uniform vec4 cut; uniform vec4 landmarks; uniform vec2 neckline;  // height / stature at the middle, steepness
uniform vec3 skin, hair, top_a, top_b, bottom_a, bottom_b, shoe, gold, lips;
uniform vec2 top_pattern, bottom_pattern; uniform float has_hair, jewels, sash, wrinkle;
void main() {
    vec3 n = normalize(normal); vec4 c = coord;
    bool arm = c.y > 0.0; float gloss = 0.25, metal = 0.0;
    vec3 q = (rest - vec3(0, landmarks.yz)) / landmarks.w;
    vec3 a = skin * (0.93 + 0.14 * noise(rest * 25.0)); bool cloth_here = false;
    bool under_neck = c.z < neckline.x + neckline.y * abs(rest.x) + (rest.z < 0.0 ? 0.035 : 0.0);
    bool top = arm ? c.x < cut.x : (c.z > cut.y && under_neck && c.z < landmarks.x + 0.02);
    bool bottom = !arm && c.z < cut.z && c.w < cut.w;
    if (bottom) { a = cloth(bottom_a, bottom_b, bottom_pattern, rest, rest.xy); cloth_here = true; gloss = 0.12; }
    if (top) {
        a = cloth(top_a, top_b, top_pattern, rest, arm ? vec2(c.x * 0.5, rest.z) : rest.xy); cloth_here = true; gloss = 0.15;
        if (jewels > 0.5 && ((arm && c.x > cut.x - 0.05) || (!arm && c.z < cut.y + 0.012))) { a = gold; gloss = 0.9; metal = 0.8; }
    }
    if (sash > 0.0 && !arm && abs(c.z - cut.z) < sash) { a = mix(top_b, gold, jewels * 0.7); gloss = 0.3; cloth_here = true; }
    if (!arm && c.w > 1.0 && shoe.x >= 0.0) { a = shoe; gloss = 0.4; }
    if (jewels > 0.5) {
        bool ring = (arm && ((c.x > 0.93 && c.x < 1.0) || (c.x > 0.28 && c.x < 0.34)))
                 || (!arm && c.w > 0.93 && c.w < 0.985)
                 || (!arm && !top && abs(c.z - landmarks.x + 0.012 + 0.05 * step(0.0, rest.z) * (0.1 - abs(rest.x)) * 6.0) < 0.009 && abs(rest.x) < 0.1);
        if (ring) { a = gold; gloss = 0.9; metal = 0.8; }
    }
    if (!arm && q.y > -0.03 && c.z > landmarks.x) {  // the head
        vec2 f = vec2(abs(q.x), q.y);
        bool face = q.z > 0.018 + 0.2 * max(q.y - 0.09, 0.0) && q.y < 0.128 - 6.0 * q.x * q.x;
        if (has_hair > 0.5 && !face && (q.y > 0.085 || q.z < 0.0 + 0.3 * (q.y - 0.05)) && q.y > -0.02 && !(f.x > 0.066 && q.y < 0.085 && q.z > -0.03)) {
            a = hair * (0.75 + 0.5 * noise(vec3(q.x * 140.0, q.y * 25.0, q.z * 60.0))); gloss = 0.5;
        } else if (q.z > 0.03) {
            vec2 e = (f - vec2(0.031, 0.068)) / vec2(0.0165, 0.0085);
            if (dot(e, e) < 1.7) a = vec3(0.05, 0.03, 0.02);
            if (dot(e, e) < 1.0) a = vec3(0.85);
            vec2 i = f - vec2(0.031, 0.069); if (dot(i, i) < 0.00006) { a = vec3(0.03, 0.02, 0.015); gloss = 0.8; }
            vec2 b = (f - vec2(0.033, 0.09 - 8.0 * pow(f.x - 0.03, 2.0))) / vec2(0.02, 0.004);
            if (dot(b, b) < 1.0) a = hair * 0.6;
            vec2 m = (f - vec2(0.0, 0.0)) / vec2(0.021, 0.0075); if (dot(m, m) < 1.0) a = lips;
            if (abs(q.y) < 0.001 && f.x < 0.019) a = lips * 0.5;
        }
    }
    if (cloth_here) {
        vec3 p = rest * vec3(22.0, 9.0, 22.0);
        n = normalize(n + wrinkle * (vec3(noise(p), noise(p + 7.0), noise(p + 13.0)) - 0.5));
    }
    pixel = vec4(shade(a, n, gloss, metal), in_mask);
}
