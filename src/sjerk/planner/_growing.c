/* What grows while a plan is made: its phases, and node paths (the acceleration at whole cycles,
   straight between).

   Along both, Eqs. (2), (3), (5) with n cycles of jerk j:
       A += n j,   V += n A + n^2 j / 2,   P += n V + n^2 A / 2 + n^3 j / 6.

   Never here: where it shall lead. */
#include "planner/_internal.h"
#include "base/_double_double.h" /* double-double sums */

/* ---- the plan ---- */

void sj_begin(sj_plan *p)
{
    p->cycles = 0;
    p->count = 0;
    p->kind = SJ_PLAN_WAIT;
    p->slipped = 0;
}

void sj_put(sj_plan *p, double n, double jerk)
{
    if (!(n > 0.0))
        return;
    p->cycles += (int64_t)n;
    if (p->count > 0 && p->phase[p->count - 1].jerk == jerk) {
        p->phase[p->count - 1].cycles += (int64_t)n;
        return;
    }
    /* cannot be: the methods add up to fewer; kept for memory's sake */
    if (p->count == SJ_PHASES)
        return;
    p->phase[p->count].cycles = (int64_t)n;
    p->phase[p->count].jerk = jerk;
    p->count++;
}

void sj_append(sj_plan *p, const sj_plan *q)
{
    for (int i = 0; i < q->count; i++)
        sj_put(p, (double)q->phase[i].cycles, q->phase[i].jerk);
}

/* What rounding in the plan is relative to. */
void sj_note_scale(sj_plan *p, const sj_limits *l)
{
    p->velocity = l->velocity;
    p->acceleration = most(l->acceleration, l->deceleration);
}

/* Whether the plan, from task t which begins after its first `used` cycles, leaves the velocity
   limit. */
int sj_leaves_velocity(const task *t, const sj_plan *p, int64_t used)
{
    double v = t->sign * t->v0, a = t->sign * t->a0;
    for (int i = 0; i < p->count; i++) {
        int64_t skipped = used < p->phase[i].cycles ? used : p->phase[i].cycles;
        double n = (double)(p->phase[i].cycles - skipped), b = a + n * p->phase[i].jerk;
        used -= skipped;
        if (piece_peak(v, n, a, b) > t->vmax * (1 + 4 * SLACK))
            return 1;
        v += n * (a + b) / 2;
        a = b;
    }
    return 0;
}

/* Acceleration after the plan so far, without drift. */
static sj_exact plan_acceleration(double first, const sj_plan *p)
{
    sj_exact a = exact_of(first);
    for (int i = 0; i < p->count; i++)
        a = exact_add(a, exact_two_product(p->phase[i].jerk, (double)p->phase[i].cycles));
    return a;
}

/* The task that remains after the plan so far; Eqs. (2), (3), (5) along its phases. */
task sj_resume(const task *start, const sj_plan *p)
{
    task t = *start;
    sj_exact h = exact_of(t.h), v = exact_of(t.v0), a = exact_of(t.a0);
    for (int i = 0; i < p->count; i++) {
        double n = (double)p->phase[i].cycles;
        sj_exact change = exact_two_product(t.sign * p->phase[i].jerk, n); /* of a */
        sj_exact third = exact_add(exact_half(a), exact_divide(change, 6.0));
        h = exact_subtract(h, exact_scale(exact_add(v, exact_scale(third, n)), n));
        v = exact_add(v, exact_scale(exact_add(a, exact_half(change)), n));
        a = exact_add(a, change);
    }
    t.h = h.hi;
    t.v0 = v.hi;
    t.a0 = a.hi;
    return t;
}

/* A cruise multiplies what rounding left of the acceleration: a long one begins by taking it
   out. */
void sj_put_cruise(sj_plan *p, const task *t, double n)
{
    if (n >= 1024) {
        double left = plan_acceleration(t->sign * t->first, p).hi;
        if (left != 0) {
            sj_put(p, 1, -left);
            n -= 1;
        }
    }
    sj_put(p, n, 0);
}

/* ---- node paths ---- */

double sj_path_change(const path *x)
{
    double dv = 0;
    for (int i = 1; i < x->count; i++)
        dv += (x->k[i] - x->k[i - 1]) * (x->a[i] + x->a[i - 1]) / 2;
    return dv;
}

double sj_path_distance(const path *x, double v)
{
    double p = 0;
    for (int i = 1; i < x->count; i++) {
        double n = x->k[i] - x->k[i - 1], a = x->a[i - 1], b = x->a[i];
        p += n * (v + n * (2 * a + b) / 6);
        v += n * (a + b) / 2;
    }
    return p;
}

double sj_path_peak(const path *x, double v)
{
    double peak = fabs(v);
    for (int i = 1; i < x->count; i++) {
        double n = x->k[i] - x->k[i - 1], a = x->a[i - 1], b = x->a[i];
        peak = most(peak, piece_peak(v, n, a, b));
        v += n * (a + b) / 2;
    }
    return peak;
}

void sj_path_put(sj_plan *p, const path *x, const task *t)
{
    for (int i = 1; i < x->count; i++) {
        double n = x->k[i] - x->k[i - 1], d = x->a[i] - x->a[i - 1];
        if (x->a[i] == 0 && x->a[i - 1] == 0)
            sj_put_cruise(p, t, n);
        else
            sj_put(p, n, t->sign * (d / n));
    }
}

void sj_node(path *x, double k, double a)
{
    if (x->count > 0 && k <= x->k[x->count - 1])
        return;
    x->k[x->count] = k;
    x->a[x->count] = a;
    x->count++;
}
