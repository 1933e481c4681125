/* The reference problem in C: simulation, sensitivities, R and normal matrix in one call.

State x and sensitivity s = dx/dtheta are integrated together by the classical Runge-Kutta method
(Eq. 4.6):

    x' = f(x, d, theta),    s' = f_x s + f_theta

f_x and f_theta are derived by hand and only their non-zero entries are computed. The 30 columns of
s, padded to 32, are four vectors of eight doubles, which the compiler maps to what the processor
has. Order of the coefficients and of the constants: equations.py. */
#include <math.h>
#include <string.h>

enum { STATES = 9, OUTPUTS = 10, CONTROLS = 3, PARAMETERS = 30, LANES = 8, GROUPS = 4 };
enum { WIDTH = LANES * GROUPS, BLOCK = 16 };
typedef double lanes __attribute__((vector_size(LANES * sizeof(double)), aligned(64)));

typedef struct {
  double mass, Ix, Iy, Iz, Ixz, S, b, cbar, density, thrust, gravity;
} Constants;

/* Quantities of an instant that rates and outputs share. Gradients are by u, v, w, p, q, r and those
   of the coefficients include the factor of the dynamic pressure: (dC + 2 C dV/V). */
typedef struct {
  double alpha, beta, pressure, C[6];
  double alpha_u, alpha_w, beta_u, beta_v, beta_w;
  double CX[6], CY[6], CZ[6], Cl[6], Cm[6], Cn[6];
  double monomials[WIDTH] __attribute__((aligned(64)));
} Instant;

#define INLINE static inline __attribute__((always_inline))

INLINE double dot(const double *a, const double *b, int from, int to) {
  double sum = 0.0;
  for (int i = from; i < to; i++) sum += a[i] * b[i];
  return sum;
}

INLINE void at_instant(const double *x, const double *d, const double *theta, const Constants *c,
                       Instant *o) {
  const double u = x[0], v = x[1], w = x[2], ds = d[0], da = d[1], dr = d[2];
  const double uw = u * u + w * w, speed2 = uw + v * v, V = sqrt(speed2), over_V = 1.0 / V;
  const double over_speed2 = over_V * over_V, over_uw = 1.0 / uw, flat = sqrt(uw);
  const double alpha = atan2(w, u), beta = asin(v * over_V);
  const double half_b = 0.5 * c->b * over_V, half_c = 0.5 * c->cbar * over_V;
  const double ph = x[3] * half_b, qh = x[4] * half_c, rh = x[5] * half_b;
  const double alpha2 = alpha * alpha, beta2 = beta * beta;
  o->alpha = alpha;
  o->beta = beta;
  o->pressure = 0.5 * c->density * speed2 * c->S;
  o->alpha_u = -w * over_uw;
  o->alpha_w = u * over_uw;
  o->beta_v = flat * over_speed2;
  o->beta_u = -u * v * over_speed2 / flat;
  o->beta_w = -w * v * over_speed2 / flat;
  const double monomials[WIDTH] = {
      1, ds, alpha2, 1, beta, dr, 1, alpha, alpha2, qh, ds, 1, beta, ph, rh, da, dr, 1, alpha,
      alpha2, alpha2 * alpha, qh, ds, 1, beta, beta2 * beta, ph, rh, da, dr, 0, 0};
  memcpy(o->monomials, monomials, sizeof monomials);
  static const int first[7] = {0, 3, 6, 11, 17, 23, 30};
  for (int i = 0; i < 6; i++) o->C[i] = dot(theta, monomials, first[i], first[i + 1]);

  /* A rate over 2V falls as V grows: minus itself times dV/V. */
  const double gu = u * over_speed2, gv = v * over_speed2, gw = w * over_speed2;
#define BY_ALPHA(G, slope, scale)              \
  G[0] = (slope) * o->alpha_u + (scale) * gu;  \
  G[1] = (scale) * gv;                         \
  G[2] = (slope) * o->alpha_w + (scale) * gw;
#define BY_BETA(G, slope, scale)               \
  G[0] = (slope) * o->beta_u + (scale) * gu;   \
  G[1] = (slope) * o->beta_v + (scale) * gv;   \
  G[2] = (slope) * o->beta_w + (scale) * gw;
  BY_ALPHA(o->CX, 2 * theta[2] * alpha, 2 * o->C[0])
  BY_BETA(o->CY, theta[4], 2 * o->C[1])
  BY_ALPHA(o->CZ, theta[7] + 2 * theta[8] * alpha, 2 * o->C[2] - theta[9] * qh)
  o->CZ[4] = theta[9] * half_c;
  BY_BETA(o->Cl, theta[12], 2 * o->C[3] - theta[13] * ph - theta[14] * rh)
  o->Cl[3] = theta[13] * half_b;
  o->Cl[5] = theta[14] * half_b;
  BY_ALPHA(o->Cm, theta[18] + 2 * theta[19] * alpha + 3 * theta[20] * alpha2,
           2 * o->C[4] - theta[21] * qh)
  o->Cm[4] = theta[21] * half_c;
  BY_BETA(o->Cn, theta[24] + 3 * theta[25] * beta2, 2 * o->C[5] - theta[26] * ph - theta[27] * rh)
  o->Cn[3] = theta[26] * half_b;
  o->Cn[5] = theta[27] * half_b;
}

/* Rows i of f_theta: weight times the monomials of one coefficient, columns from to to-1. */
INLINE void force(lanes *row, const Instant *o, double weight, int from, int to) {
  double *entries = (double *)row;
  for (int n = from; n < to; n++) entries[n] += weight * o->monomials[n];
}

INLINE void rates(const double *x, lanes (*restrict s)[GROUPS], const double *d,
                  const double *theta, const Constants *c, double *restrict dx,
                  lanes (*restrict ds)[GROUPS]) {
  Instant o;
  at_instant(x, d, theta, c, &o);
  const double u = x[0], v = x[1], w = x[2], p = x[3], q = x[4], r = x[5], g = c->gravity;
  const double sp = sin(x[6]), cp = cos(x[6]), st = sin(x[7]), ct = cos(x[7]);
  const double m = o.pressure / c->mass, Mb = o.pressure * c->b, Mc = o.pressure * c->cbar / c->Iy;
  const double det = c->Ix * c->Iz - c->Ixz * c->Ixz;
  const double izz = c->Iz / det, ixz = c->Ixz / det, ixx = c->Ix / det;
  const double y = q * sp + r * cp, z = q * cp - r * sp, psidot = y / ct, t = st / ct;
  /* omega x I omega: roll = A q r + Ixz p q, yaw = B p q - Ixz q r */
  const double A = c->Iy - c->Iz, B = c->Ix - c->Iy, D = (c->Iz - c->Ix) / c->Iy;
  const double E = c->Ixz / c->Iy;
  const double roll = Mb * o.C[3] + A * q * r + c->Ixz * p * q;
  const double yaw = Mb * o.C[5] + B * p * q - c->Ixz * q * r;
  dx[0] = r * v - q * w + m * o.C[0] + c->thrust / c->mass - g * st;
  dx[1] = p * w - r * u + m * o.C[1] + g * ct * sp;
  dx[2] = q * u - p * v + m * o.C[2] + g * ct * cp;
  dx[3] = izz * roll + ixz * yaw;
  dx[4] = Mc * o.C[4] + D * p * r - E * (p * p - r * r);
  dx[5] = ixz * roll + ixx * yaw;
  dx[6] = p + st * psidot;
  dx[7] = z;
  dx[8] = psidot;

  const double X0 = m * o.CX[0], X1 = m * o.CX[1] + r, X2 = m * o.CX[2] - q;
  const double Y0 = m * o.CY[0] - r, Y1 = m * o.CY[1], Y2 = m * o.CY[2] + p;
  const double Z0 = m * o.CZ[0] + q, Z1 = m * o.CZ[1] - p, Z2 = m * o.CZ[2];
  const double Z4 = m * o.CZ[4] + u;
  double R[6], N[6], P[6], W[6];
  for (int i = 0; i < 3; i++) {
    R[i] = Mb * o.Cl[i];
    N[i] = Mb * o.Cn[i];
  }
  R[3] = Mb * o.Cl[3] + c->Ixz * q;
  R[4] = A * r + c->Ixz * p;
  R[5] = Mb * o.Cl[5] + A * q;
  N[3] = Mb * o.Cn[3] + B * q;
  N[4] = B * p - c->Ixz * r;
  N[5] = Mb * o.Cn[5] - c->Ixz * q;
  for (int i = 0; i < 6; i++) {
    P[i] = izz * R[i] + ixz * N[i];
    W[i] = ixz * R[i] + ixx * N[i];
  }
  const double Q0 = Mc * o.Cm[0], Q1 = Mc * o.Cm[1], Q2 = Mc * o.Cm[2], Q4 = Mc * o.Cm[4];
  const double Q3 = D * r - 2 * E * p, Q5 = D * p + 2 * E * r;
  for (int n = 0; n < GROUPS; n++) {
    const lanes s0 = s[0][n], s1 = s[1][n], s2 = s[2][n], s3 = s[3][n], s4 = s[4][n];
    const lanes s5 = s[5][n], s6 = s[6][n], s7 = s[7][n];
    ds[0][n] = X0 * s0 + X1 * s1 + X2 * s2 - w * s4 + v * s5 - (g * ct) * s7;
    ds[1][n] = Y0 * s0 + Y1 * s1 + Y2 * s2 + w * s3 - u * s5 + (g * ct * cp) * s6 -
               (g * st * sp) * s7;
    ds[2][n] = Z0 * s0 + Z1 * s1 + Z2 * s2 - v * s3 + Z4 * s4 - (g * ct * sp) * s6 -
               (g * st * cp) * s7;
    ds[3][n] = P[0] * s0 + P[1] * s1 + P[2] * s2 + P[3] * s3 + P[4] * s4 + P[5] * s5;
    ds[4][n] = Q0 * s0 + Q1 * s1 + Q2 * s2 + Q3 * s3 + Q4 * s4 + Q5 * s5;
    ds[5][n] = W[0] * s0 + W[1] * s1 + W[2] * s2 + W[3] * s3 + W[4] * s4 + W[5] * s5;
    ds[6][n] = s3 + (sp * t) * s4 + (cp * t) * s5 + (z * t) * s6 + (psidot / ct) * s7;
    ds[7][n] = cp * s4 - sp * s5 - y * s6;
    ds[8][n] = (sp / ct) * s4 + (cp / ct) * s5 + (z / ct) * s6 + (psidot * t) * s7;
  }
  force(ds[0], &o, m, 0, 3);
  force(ds[1], &o, m, 3, 6);
  force(ds[2], &o, m, 6, 11);
  force(ds[3], &o, Mb * izz, 11, 17);
  force(ds[3], &o, Mb * ixz, 23, 30);
  force(ds[4], &o, Mc, 17, 23);
  force(ds[5], &o, Mb * ixz, 11, 17);
  force(ds[5], &o, Mb * ixx, 23, 30);
}

INLINE void outputs(const double *x, lanes (*restrict s)[GROUPS], const double *d,
                    const double *theta, const Constants *c, double *restrict y,
                    lanes (*restrict dy)[GROUPS]) {
  Instant o;
  at_instant(x, d, theta, c, &o);
  const double m = o.pressure / c->mass;
  const double values[OUTPUTS] = {o.alpha, o.beta, x[3], x[4], x[5],
                                  m * o.C[0] + c->thrust / c->mass, m * o.C[1], m * o.C[2],
                                  x[6], x[7]};
  memcpy(y, values, sizeof values);
  for (int n = 0; n < GROUPS; n++) {
    dy[0][n] = o.alpha_u * s[0][n] + o.alpha_w * s[2][n];
    dy[1][n] = o.beta_u * s[0][n] + o.beta_v * s[1][n] + o.beta_w * s[2][n];
    for (int i = 0; i < 3; i++) dy[2 + i][n] = s[3 + i][n];
    dy[5][n] = m * (o.CX[0] * s[0][n] + o.CX[1] * s[1][n] + o.CX[2] * s[2][n]);
    dy[6][n] = m * (o.CY[0] * s[0][n] + o.CY[1] * s[1][n] + o.CY[2] * s[2][n]);
    dy[7][n] = m * (o.CZ[0] * s[0][n] + o.CZ[1] * s[1][n] + o.CZ[2] * s[2][n] +
                    o.CZ[4] * s[4][n]);
    dy[8][n] = s[6][n];
    dy[9][n] = s[7][n];
  }
  force(dy[5], &o, m, 0, 3);
  force(dy[6], &o, m, 3, 6);
  force(dy[7], &o, m, 6, 11);
}

typedef struct {
  double x[STATES];
  lanes s[STATES][GROUPS];
} Both;

/* to = from + length slope */
INLINE void along(const Both *from, double length, const Both *slope, Both *to) {
  for (int i = 0; i < STATES; i++) {
    to->x[i] = from->x[i] + length * slope->x[i];
    for (int n = 0; n < GROUPS; n++) to->s[i][n] = from->s[i][n] + length * slope->s[i][n];
  }
}

static void step(Both *now, const double *before, const double *after, double h,
                 const double *theta, const Constants *c) {
  double middle[CONTROLS];
  Both k1, k2, k3, k4, at;
  for (int i = 0; i < CONTROLS; i++) middle[i] = 0.5 * (before[i] + after[i]);
  rates(now->x, now->s, before, theta, c, k1.x, k1.s);
  along(now, 0.5 * h, &k1, &at);
  rates(at.x, at.s, middle, theta, c, k2.x, k2.s);
  along(now, 0.5 * h, &k2, &at);
  rates(at.x, at.s, middle, theta, c, k3.x, k3.s);
  along(now, h, &k3, &at);
  rates(at.x, at.s, after, theta, c, k4.x, k4.s);
  const double sixth = h / 6.0;
  for (int i = 0; i < STATES; i++) {
    now->x[i] += sixth * (k1.x[i] + 2.0 * (k2.x[i] + k3.x[i]) + k4.x[i]);
    for (int n = 0; n < GROUPS; n++)
      now->s[i][n] += sixth * (k1.s[i][n] + 2.0 * (k2.s[i][n] + k3.s[i][n]) + k4.s[i][n]);
  }
}

/* matrix += J'J over some rows: tiles of eight by eight stay in registers. */
static void add_product(const lanes (*restrict J)[GROUPS], int rows, lanes (*matrix)[GROUPS]) {
  for (int left = 0; left < GROUPS; left++)
    for (int right = 0; right <= left; right++) {
      lanes tile[LANES];
      for (int i = 0; i < LANES; i++) tile[i] = matrix[LANES * left + i][right];
      for (int row = 0; row < rows; row++) {
        const double *entries = (const double *)&J[row][left];
        const lanes other = J[row][right];
#pragma GCC unroll 8
        for (int i = 0; i < LANES; i++) tile[i] += entries[i] * other;
      }
      for (int i = 0; i < LANES; i++) matrix[LANES * left + i][right] = tile[i];
    }
}

/* Cost N/2 (log det R + 10), normal matrix S'R^-1 S (32 x 32) and gradient S'R^-1 v. */
static double normal_equations(const double *z, const double *y, const lanes (*S)[GROUPS], int count,
                               double *noise, lanes (*matrix)[GROUPS], lanes *gradient) {
  double weight[OUTPUTS], cost = 0.0;
  for (int j = 0; j < OUTPUTS; j++) {
    double sum = 0.0;
    for (int k = 0; k < count; k++) {
      const double v = z[OUTPUTS * k + j] - y[OUTPUTS * k + j];
      sum += v * v;
    }
    noise[j] = sum / count;
    cost += 0.5 * count * (log(noise[j]) + 1.0);
    weight[j] = 1.0 / sqrt(noise[j]);
  }
  memset(matrix, 0, WIDTH * GROUPS * sizeof(lanes));
  memset(gradient, 0, GROUPS * sizeof(lanes));
  lanes white[BLOCK * OUTPUTS][GROUPS];
  for (int k = 0; k < count; k += BLOCK) {
    const int rows = OUTPUTS * (count - k < BLOCK ? count - k : BLOCK);
    for (int i = 0; i < rows; i++) {
      const int row = OUTPUTS * k + i;
      const double w = weight[i % OUTPUTS], v = w * (z[row] - y[row]);
      for (int n = 0; n < GROUPS; n++) {
        white[i][n] = w * S[row][n];
        gradient[n] += v * white[i][n];
      }
    }
    add_product((const lanes(*)[GROUPS])white, rows, matrix);
  }
  double *entries = (double *)matrix;
  for (int i = 0; i < WIDTH; i++)
    for (int j = 0; j < i; j++) entries[WIDTH * j + i] = entries[WIDTH * i + j];
  return cost;
}

/* One pass. All arrays are row-major and aligned to 64 bytes; S is (count, 10, 32). */
double evaluate(const double *theta, const double *t, const double *u, const double *z, int count,
                const Constants *c, const double *x0, double *y, double *S, double *noise,
                double *matrix, double *gradient) {
  Both now;
  memset(&now, 0, sizeof now);
  memcpy(now.x, x0, sizeof now.x);
  lanes(*rows)[GROUPS] = (lanes(*)[GROUPS])S;
  for (int k = 0; k < count; k++) {
    const double *d = u + CONTROLS * k;
    outputs(now.x, now.s, d, theta, c, y + OUTPUTS * k, rows + OUTPUTS * k);
    if (k + 1 < count) step(&now, d, d + CONTROLS, t[k + 1] - t[k], theta, c);
  }
  return normal_equations(z, y, (const lanes(*)[GROUPS])rows, count, noise,
                          (lanes(*)[GROUPS])matrix, (lanes *)gradient);
}
