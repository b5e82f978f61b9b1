/* The engine's right-hand side written by hand in C, as one would write it without a compiler for bond graphs: the yardstick for
 * the compiled model's speed. Order of states and meaning as in tests/engine/engine_reference.py, against which it is checked.
 *
 *     void engine_rhs(const double *y, const double *gain, const double *coef, double *dy)
 *
 * coef: 720 x 4 coefficients of the cubic pieces of the gas table, highest power first, one piece a degree. */
#include <math.h>
#include <string.h>

typedef struct { double v[3], w[3], R[9], f[3], m[3]; } Body;

enum { BLOCK = 0, CRANK = 1, ROD = 2, PISTON = 8, BODIES = 14 };

static const double MASS[4] = {1207.0, 300.0, 6.32, 5.08};
static const double J[4][3] = {{122.3, 238.6, 233.1}, {4.23, 70.38, 70.38}, {0.0888, 0.0865, 0.0070}, {0.0120, 0.0120, 0.0095}};
static const double PIN[6][3] = {{0, 0, 0.08}, {0.1651, 0.0693, -0.04}, {0.3302, -0.0693, -0.04},
                                 {0.4953, -0.0693, -0.04}, {0.6604, 0.0693, -0.04}, {0.8255, 0, 0.08}};
static const double BLOCK_CG[3] = {0.4430, -0.0088, 0.2830}, CRANK_CG[3] = {0.4920, 0, 0};
static const double MAIN_A[3] = {-0.0830, 0, 0}, MAIN_B[3] = {0.9085, 0, 0};
static const double ROD_C[3] = {0, 0, -0.111}, ROD_D[3] = {0, 0, 0.158}, PISTON_D[3] = {0, 0, -0.050};
static const double MOUNT[3][3] = {{-0.318, 0, -0.197}, {1.0, -0.318, 0}, {1.0, 0.318, 0}};
static const double MOUNT_K[3][3] = {{193.1e3, 193.1e3, 1410e3}, {314.5e3, 314.5e3, 157.0e3}, {314.5e3, 314.5e3, 157.0e3}};
static const double MOUNT_R[3][3] = {{2340, 2340, 6340}, {2990, 2990, 2110}, {2990, 2990, 2110}};
static const double FIRING[6] = {0, 480, 240, 600, 120, 360};

static inline void cross(const double *a, const double *b, double *c) {
    c[0] = a[1] * b[2] - a[2] * b[1];
    c[1] = a[2] * b[0] - a[0] * b[2];
    c[2] = a[0] * b[1] - a[1] * b[0];
}
static inline void into_n(const double *R, const double *a, double *b) {
    for (int i = 0; i < 3; i++) b[i] = R[3 * i] * a[0] + R[3 * i + 1] * a[1] + R[3 * i + 2] * a[2];
}
static inline void into_body(const double *R, const double *a, double *b) {
    for (int i = 0; i < 3; i++) b[i] = R[i] * a[0] + R[3 + i] * a[1] + R[6 + i] * a[2];
}
static inline void point(const Body *b, const double *arm, double *v) {
    double u[3];
    cross(b->w, arm, u);
    for (int k = 0; k < 3; k++) u[k] += b->v[k];
    into_n(b->R, u, v);
}
/* a force s f, given in N, at a point of a body */
static inline void push(Body *b, const double *arm, const double *f, double s) {
    double own[3], m[3];
    into_body(b->R, f, own);
    cross(arm, own, m);
    for (int k = 0; k < 3; k++) { b->f[k] += s * own[k]; b->m[k] += s * m[k]; }
}
static inline void ball(Body *one, const double *arm1, Body *two, const double *arm2, double K, double R, int from, const double *q, double *dq) {
    double a[3], b[3], e[3] = {0, 0, 0};
    point(one, arm1, a);
    point(two, arm2, b);
    for (int k = from; k < 3; k++) {
        dq[k - from] = a[k] - b[k];
        e[k] = K * q[k - from] + R * dq[k - from];
    }
    push(one, arm1, e, -1.0);
    push(two, arm2, e, 1.0);
}
static inline void minus(const double *a, const double *b, double *c) { for (int k = 0; k < 3; k++) c[k] = a[k] - b[k]; }

static double gas(double theta, double firing, const double *coef) {
    double deg = theta * 57.29577951308232 - firing;
    deg -= 720.0 * floor(deg / 720.0);
    int i = (int)deg;
    if (i > 719) i = 719;
    double d = deg - i;
    const double *c = coef + 4 * i;
    return ((c[0] * d + c[1]) * d + c[2]) * d + c[3];
}

void engine_rhs(const double *y, const double *gain, const double *coef, double *dy) {
    Body body[BODIES];
    double arm[3], rel[3], e[3], u[3], n[3];
    for (int i = 0; i < BODIES; i++) {
        Body *b = body + i;
        int kind = i < 2 ? i : i < PISTON ? 2 : 3;
        const double *p = y + 6 * i, *h = p + 3, *pose = y + 84 + 6 * i;
        double sa = sin(pose[3]), ca = cos(pose[3]), sb = sin(pose[4]), cb = cos(pose[4]), sc = sin(pose[5]), cc = cos(pose[5]);
        double R[9] = {cb * cc, -cb * sc, sb, ca * sc + sa * sb * cc, ca * cc - sa * sb * sc, -sa * cb,
                       sa * sc - ca * sb * cc, sa * cc + ca * sb * sc, ca * cb};
        memcpy(b->R, R, sizeof R);
        for (int k = 0; k < 3; k++) { b->v[k] = p[k] / MASS[kind]; b->w[k] = h[k] / J[kind][k]; }
        cross(p, b->w, b->f);
        cross(h, b->w, b->m);
        for (int k = 0; k < 3; k++) b->f[k] -= MASS[kind] * 9.81 * R[6 + k];
        double *dpose = dy + 84 + 6 * i;
        into_n(R, b->v, dpose);
        dpose[3] = (cc * b->w[0] - sc * b->w[1]) / cb;
        dpose[4] = sc * b->w[0] + cc * b->w[1];
        dpose[5] = b->w[2] - sb * dpose[3];
    }
    Body *block = body + BLOCK, *crank = body + CRANK;
    for (int m = 0; m < 3; m++) {
        const double *q = y + 168 + 3 * m;
        double *dq = dy + 168 + 3 * m;
        minus(MOUNT[m], BLOCK_CG, arm);
        cross(block->w, arm, dq);
        for (int k = 0; k < 3; k++) { dq[k] += block->v[k]; e[k] = MOUNT_K[m][k] * q[k] + MOUNT_R[m][k] * dq[k]; }
        cross(arm, e, u);
        for (int k = 0; k < 3; k++) { block->f[k] -= e[k]; block->m[k] -= u[k]; }
    }
    double arm2[3];
    minus(MAIN_A, CRANK_CG, arm); minus(MAIN_A, BLOCK_CG, arm2);
    ball(crank, arm, block, arm2, 2e10, 1e6, 0, y + 177, dy + 177);
    minus(MAIN_B, CRANK_CG, arm); minus(MAIN_B, BLOCK_CG, arm2);
    ball(crank, arm, block, arm2, 2e10, 1e6, 1, y + 180, dy + 180);
    into_n(crank->R, crank->w, n);
    into_body(block->R, n, u);
    dy[182] = u[0] - block->w[0];
    double friction[3] = {30.0 * dy[182], 0, 0};
    block->m[0] += friction[0];
    into_n(block->R, friction, n);
    into_body(crank->R, n, u);
    for (int k = 0; k < 3; k++) crank->m[k] -= u[k];

    for (int i = 0; i < 6; i++) {
        Body *rod = body + ROD + i, *piston = body + PISTON + i;
        const double *q = y + 183 + 13 * i;
        double *dq = dy + 183 + 13 * i, wn[3];
        minus(PIN[i], CRANK_CG, arm);
        ball(crank, arm, rod, ROD_C, 1e10, 2e5, 0, q, dq);
        ball(rod, ROD_D, piston, PISTON_D, 1e10, 2e5, 0, q + 3, dq + 3);
        into_n(piston->R, piston->w, wn);
        dq[6] = rod->R[2] * wn[0] + rod->R[5] * wn[1] + rod->R[8] * wn[2] - rod->w[2];
        double t = 1e5 * q[6] + 20 * dq[6], z[3] = {rod->R[2] * t, rod->R[5] * t, rod->R[8] * t};
        rod->m[2] += t;
        into_body(block->R, wn, u);
        for (int k = 0; k < 3; k++) {
            dq[7 + k] = u[k] - block->w[k];
            e[k] = 5e7 * q[7 + k] + 500 * dq[7 + k];
            block->m[k] += e[k];
        }
        into_n(block->R, e, n);
        for (int k = 0; k < 3; k++) n[k] += z[k];
        into_body(piston->R, n, u);
        for (int k = 0; k < 3; k++) piston->m[k] -= u[k];

        double at[3] = {PIN[i][0] - BLOCK_CG[0], -BLOCK_CG[1], q[12] - BLOCK_CG[2]};
        into_n(piston->R, piston->v, n);
        into_body(block->R, n, u);
        cross(block->w, at, rel);
        for (int k = 0; k < 3; k++) dq[10 + k] = u[k] - block->v[k] - rel[k];
        e[0] = 1e10 * q[10] + 2e5 * dq[10];
        e[1] = 1e10 * q[11] + 2e5 * dq[11];
        e[2] = gain[i] == 0.0 ? 0.0 : gain[i] * gas(y[182], FIRING[i], coef);
        cross(at, e, u);
        for (int k = 0; k < 3; k++) { block->f[k] += e[k]; block->m[k] += u[k]; }
        into_n(block->R, e, n);
        into_body(piston->R, n, u);
        for (int k = 0; k < 3; k++) piston->f[k] -= u[k];
    }
    for (int i = 0; i < BODIES; i++) {
        memcpy(dy + 6 * i, body[i].f, sizeof body[i].f);
        memcpy(dy + 6 * i + 3, body[i].m, sizeof body[i].m);
    }
}

/* n evaluations in a row, for timing */
void engine_repeat(int n, const double *y, const double *gain, const double *coef, double *dy) {
    for (int i = 0; i < n; i++) engine_rhs(y, gain, coef, dy);
}
