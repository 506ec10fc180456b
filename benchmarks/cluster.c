/* The two-canopy cluster in plain C: the yardstick of simulator.py. Same equations, same Runge-Kutta steps.
 *
 * LANES flights are advanced side by side (structure of arrays, vectors of LANES numbers); LANES = 1 is the scalar
 * program. Terms: axial 1, alpha^2; transverse e, e*alpha^2, rate, repulsion(0.8); pivot-point rate. */
#include <math.h>
#include <string.h>

#ifndef LANES
#define LANES 8
#endif
enum { STATES = 25, ERRORS = 5, RECORD = 6 }; /* record: wind (3), density, axial factors (2) */

#if LANES == 1
typedef double num;
typedef int mask;
static inline num pick(mask m, num a, num b) { return m ? a : b; }
static inline num root(num a) { return sqrt(a); }
static inline num all(double a) { return a; }
#else
typedef double num __attribute__((vector_size(8 * LANES)));
typedef long mask __attribute__((vector_size(8 * LANES)));
static inline num pick(mask m, num a, num b) { return (num)(((mask)a & m) | ((mask)b & ~m)); }
static inline num root(num a) {
    for (int l = 0; l < LANES; l++) a[l] = sqrt(a[l]);
    return a;
}
static inline num all(double a) { return a - (num){0}; }
#endif
static inline num load(const double *from) {
    num a;
    memcpy(&a, from, sizeof a);
    return a;
}
static inline num positive(num a) { return pick(a > 0.0, a, all(0.0)); }

typedef struct { num x, y, z; } V;
static inline V vec(num x, num y, num z) { V v = {x, y, z}; return v; }
static inline V plus(V a, V b) { return vec(a.x + b.x, a.y + b.y, a.z + b.z); }
static inline V minus(V a, V b) { return vec(a.x - b.x, a.y - b.y, a.z - b.z); }
static inline V times(num k, V a) { return vec(k * a.x, k * a.y, k * a.z); }
static inline num dot(V a, V b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
static inline V cross(V a, V b) { return vec(a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x); }
static inline V across(V a, V axis) { return minus(a, times(dot(a, axis), axis)); }
static inline V turned(num w, V q, V v) { /* by the quaternion (w, q) */
    V t = times(all(2.0), cross(q, v));
    return plus(plus(v, times(w, t)), cross(q, t));
}

/* Angle of (c, s), s > 0, without a call. */
static inline num angle(num s, num c) {
    num b = pick(c < 0.0, -c, c);
    mask steep = s > b;
    num hi = pick(steep, s, b), lo = pick(steep, b, s);
    mask one = lo > 0.198912367379658 * hi, two = lo > 0.668178637919299 * hi;
    num slope = pick(two, all(1.0), pick(one, all(0.414213562373095049), all(0.0)));
    num base = pick(two, all(M_PI_4), pick(one, all(M_PI_4 / 2.0), all(0.0)));
    num t = (lo - slope * hi) / (hi + slope * lo), z = t * t, y = z * z;
    num odd = -1.0 / 3 + y * (-1.0 / 7 + y * (-1.0 / 11 + y * (-1.0 / 15 + y * (-1.0 / 19 - y / 23))));
    num even = 1.0 / 5 + y * (1.0 / 9 + y * (1.0 / 13 + y * (1.0 / 17 + y * (1.0 / 21))));
    num a = base + (t + t * z * (odd + z * even));
    a = pick(steep, M_PI_2 - a, a);
    return pick(c < 0.0, M_PI - a, a);
}

typedef struct {
    double mass, ix, iy, iz, ax, ay, az, rx, ry, rz, area, length, axial, normal, moment, roll, pitch; /* capsule */
    double s, l, speed, dry, volume;                                                                   /* canopies */
    double riser_length, engagement, gravity;
} Vehicle;

/* Of one flight: axial (2), transverse (4), riser stiffness and damping, enclosed-air factor. */
typedef struct { num c1, c2, e, e2, rate, repulsion, stiffness, damping, air; } Parameters;

static inline void rate(const Vehicle *restrict c, const Parameters *restrict k, const num *restrict x,
                        const num *restrict air, num *restrict dx) {
    V p = vec(x[0], x[1], x[2]), v = vec(x[3], x[4], x[5]), q = vec(x[7], x[8], x[9]), w = vec(x[10], x[11], x[12]);
    V wind = vec(air[0], air[1], air[2]), arm = vec(all(c->ax), all(c->ay), all(c->az));
    num qw = x[6], rho = air[3];
    V attach = plus(p, turned(qw, q, arm)), end = plus(v, turned(qw, q, cross(w, arm)));
    V apart = vec(x[13] - x[14], x[15] - x[16], x[17] - x[18]);
    num distance = root(dot(apart, apart) + 1e-12);
    V away = times(1.0 / distance, apart), pull = vec(all(0.0), all(0.0), all(0.0)), known[2];
    num near = positive(0.8 - distance * (1.0 / c->l)) * k->repulsion;
    for (int i = 0; i < 2; i++) {
        V vc = vec(x[19 + i], x[21 + i], x[23 + i]);
        V r = minus(vec(x[13 + i], x[15 + i], x[17 + i]), attach), u = minus(vc, end), rel = minus(vc, wind);
        num length = root(dot(r, r)), inverse = 1.0 / length, stretch = length - c->riser_length;
        V n = times(inverse, r), axis = times(all(-1.0), n);
        num taut = stretch * (1.0 / c->engagement), share = pick(taut < 1.0, taut * taut * (3.0 - 2.0 * taut), all(1.0));
        num force = positive(k->stiffness * stretch + k->damping * dot(n, u));
        num tension = pick(stretch > 0.0, share * force, all(0.0));
        num speed2 = dot(rel, rel) + 1e-12, slow = 1.0 / root(speed2);
        V d = times(slow, rel);
        num cosine = dot(d, axis);
        V e = minus(d, times(cosine, axis));
        num s2 = dot(e, e);
        mask small = s2 < 1e-8;
        num alpha = angle(root(pick(small, all(1e-8), s2)), cosine);
        num a2 = pick(small & (cosine > 0.0), s2 * (1.0 + s2 * (1.0 / 3.0)), alpha * alpha);
        V turning = times(inverse * cosine * slow * (0.5 * c->l), across(u, n));
        num dynamic = 0.5 * rho * speed2 * c->s, axial = (k->c1 + k->c2 * a2) * air[4 + i];
        V side = plus(times(k->e + k->e2 * a2, e), times(k->rate, turning));
        side = minus(times(i ? -near : near, across(away, axis)), side);
        V f = minus(times(dynamic, minus(side, times(axial, axis))), times(tension, n));
        f.z += c->dry * c->gravity;
        known[i] = f;
        pull = plus(pull, times(tension, n));
    }
    num canopy = 1.0 / (c->dry + rho * (c->volume * k->air));
    V qc = times(all(-1.0), q), vb = turned(qw, qc, minus(v, wind));
    num speed2 = dot(vb, vb) + 1e-12, speed = root(speed2), slow = 1.0 / speed, qa = rho * speed2 * (0.5 * c->area);
    V along = times(slow, vb);
    V fb = vec(-c->axial * qa, -c->normal * along.y * qa, -c->normal * along.z * qa);
    num ml = c->moment * c->length * qa, damping = qa * slow * (0.5 * c->length * c->length);
    V m = vec(c->roll * w.x * damping, ml * along.z + c->pitch * w.y * damping, c->pitch * w.z * damping - ml * along.y);
    m = plus(m, cross(vec(all(c->rx), all(c->ry), all(c->rz)), fb));
    m = plus(m, cross(arm, turned(qw, qc, pull)));
    m = minus(m, cross(w, vec(c->ix * w.x, c->iy * w.y, c->iz * w.z)));
    V a = times(all(1.0 / c->mass), plus(pull, turned(qw, q, fb)));
    dx[0] = v.x, dx[1] = v.y, dx[2] = v.z, dx[3] = a.x, dx[4] = a.y, dx[5] = a.z + c->gravity;
    dx[6] = 0.5 * (-q.x * w.x - q.y * w.y - q.z * w.z), dx[7] = 0.5 * (qw * w.x + q.y * w.z - q.z * w.y);
    dx[8] = 0.5 * (qw * w.y + q.z * w.x - q.x * w.z), dx[9] = 0.5 * (qw * w.z + q.x * w.y - q.y * w.x);
    dx[10] = m.x * (1.0 / c->ix), dx[11] = m.y * (1.0 / c->iy), dx[12] = m.z * (1.0 / c->iz);
    for (int i = 0; i < 6; i++) dx[13 + i] = x[19 + i];
    for (int i = 0; i < 2; i++) dx[19 + i] = canopy * known[i].x, dx[21 + i] = canopy * known[i].y, dx[23 + i] = canopy * known[i].z;
}

/* Air at a sample, and its change to the next one. */
static inline void sample(const double *record, const double *error, long t, long stride, num *from, num *by) {
    for (int i = 0; i < RECORD; i++) {
        const double *e = error + (t * ERRORS + i - (i > 3)) * stride;
        from[i] = all(record[t * RECORD + i]), by[i] = all(record[(t + 1) * RECORD + i]);
        if (i != 3) from[i] += load(e), by[i] += load(e + ERRORS * stride);
        by[i] -= from[i];
    }
}

#if LANES == 1
/* Rate of one flight at a time, for solvers that ask for it. */
void rate_at(const Vehicle *c, const double *parameters, const double *record, const double *error, long samples,
             double dt, double time, const double *x, double *dx) {
    Parameters fixed;
    num air[RECORD], by[RECORD];
    long t = (long)floor(time / dt);
    t = t < 0 ? 0 : t > samples - 2 ? samples - 2 : t;
    memcpy(&fixed, parameters, sizeof fixed);
    sample(record, error, t, 1, air, by);
    for (int i = 0; i < RECORD; i++) air[i] += by[i] * (time / dt - t);
    rate(c, &fixed, x, air, dx);
}
#endif

/* Flights of one block: parameters (9, stride), record (T, RECORD), error (T, ERRORS, stride), states (T, STATES,
 * stride) with the first sample given. */
void simulate(const Vehicle *restrict c, const double *restrict parameters, const double *restrict record,
              const double *restrict error, double *restrict states, long samples, long stride, double dt, long substeps) {
    num x[STATES], y[STATES], sum[STATES], k[STATES], air[RECORD], from[RECORD], by[RECORD], given[9];
    const double h = dt / substeps, way[4] = {0.5 * h, 0.5 * h, h, 0}, weight[4] = {h / 6, h / 3, h / 3, h / 6};
    const double within[4] = {0.0, 0.5, 0.5, 1.0};
    Parameters fixed;
    for (int i = 0; i < 9; i++) given[i] = load(parameters + i * stride);
    memcpy(&fixed, given, sizeof fixed);
    for (int i = 0; i < STATES; i++) x[i] = load(states + i * stride);
    for (long t = 0; t + 1 < samples; t++) {
        sample(record, error, t, stride, from, by);
        for (long s = 0; s < substeps; s++) {
            for (int i = 0; i < STATES; i++) y[i] = sum[i] = x[i];
            for (int stage = 0; stage < 4; stage++) {
                for (int i = 0; i < RECORD; i++) air[i] = from[i] + by[i] * ((s + within[stage]) / substeps);
                rate(c, &fixed, y, air, k);
                for (int i = 0; i < STATES; i++) sum[i] += weight[stage] * k[i], y[i] = x[i] + way[stage] * k[i];
            }
            memcpy(x, sum, sizeof x);
        }
        for (int i = 0; i < STATES; i++) memcpy(states + ((t + 1) * STATES + i) * stride, &x[i], sizeof x[i]);
    }
}
