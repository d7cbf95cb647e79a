/*
 * A gimbal's controller, written by gimbal-pin: C99, single precision, no allocation, no global state but the constant
 * default parameters, no library but math.h.
 *
 * Units: rad, rad/s, rad/s^2, N m, kg m^2, m/s^2, s. Angles and torques are in the order of the joints in
 * gimbal_joint_names. Quaternions are (w, x, y, z). Matrices are row by row.
 *
 * Frames: an IMU's readings are in its link's frame of the URDF: x of the camera's frame is the line of sight.
 * Accelerometers report specific force: +9.81 upwards at rest.
 *
 * Timing: call a step once every `dt` seconds of the parameters, in one interrupt or task: read the sensors, step,
 * command the torques. Each torque is held until the next. The gains allow for the delay from measurement to torque
 * that the controller was tuned for; see README.md.
 */
#ifndef GIMBAL_CONTROLLER_H
#define GIMBAL_CONTROLLER_H

#include <stdbool.h>
#include <stdint.h>

#include "gimbal_sizes.h"

/* --- Parameters: constant while a controller runs, or changed between two steps --------------------------------- */

/* Which law is inside. */
enum gimbal_law { GIMBAL_COMPUTED_TORQUE, GIMBAL_PID };

/* One joint's outer loop, in acceleration: kp e + ki int(e) + kd de/dt. */
struct gimbal_loop {
    float kp;      /* 1/s^2 */
    float ki;      /* 1/s^3 */
    float kd;      /* 1/s */
    float knee;    /* error beyond which the joint comes in on a parabola of constant deceleration, rad */
    float braking; /* that deceleration, rad/s^2; infinite: the loop is linear */
    float inertia; /* what a PID multiplies its acceleration by, kg m^2 */
};

/* Lyapunov redesign: w = size z/|z| outside a boundary layer, gain z inside it; all zero without it. */
struct gimbal_robust {
    float direction[3 * GIMBAL_JOINTS]; /* z of a joint: what multiplies integral, error and rate of the error */
    float alpha;                        /* bound of the relative error of the model's inertia, below 1 */
    float disturbance;                  /* acceleration by the rest of the model's error, rad/s^2 */
    float gain;                         /* slope inside the layer */
};

/* Terms of the model beside the rigid body, joint by joint. */
struct gimbal_terms {
    float constant[GIMBAL_JOINTS];   /* N m */
    float per_slide[GIMBAL_JOINTS];  /* dry friction, N m */
    float per_rate[GIMBAL_JOINTS];   /* viscous friction, N m s/rad */
    float others[GIMBAL_OTHERS];     /* coefficients of all other terms (cogging, ...), see gimbal_model.h */
};

/* What to command so that a drive gives a torque: points of a curve; without points the torque itself. */
struct gimbal_drive {
    int first; /* of its points in gimbal_drive_points */
    int count;
};

/* A point of such a curve, N m. */
struct gimbal_point {
    float torque;
    float command;
};

/* How a forecast of the base's motion is compared with what was then measured; shares and steps are per sample. */
struct gimbal_judging {
    float slow;   /* share of an error in the slow errors */
    float mean;   /* share of its square in the mean squares */
    float rise;   /* of the trust in a forecast that errs less than none */
    float fall;   /* the same of one that errs more */
};

/* How fast joints may turn the camera to where it shall look. */
struct gimbal_pace {
    float home[GIMBAL_JOINTS];                    /* angles from which those are looked for at which it does, rad */
    float rate[GIMBAL_JOINTS];                    /* rad/s */
    float torque[GIMBAL_JOINTS];                  /* that every motor surely has for it, N m */
    float inertia[GIMBAL_JOINTS * GIMBAL_JOINTS]; /* largest of any pose, without sign, kg m^2 */
    float near;                                   /* way up to which the loop answers as to any error, rad */
    float ramp;                                   /* time in which a turn becomes fast at least, s */
    float lower[GIMBAL_JOINTS];                   /* limits of the angles, rad */
    float upper[GIMBAL_JOINTS];
};

/* Channels of the sensors, in the order in which they are checked. */
enum gimbal_channel {
    GIMBAL_ENCODERS,
    GIMBAL_CAMERA_GYRO,
    GIMBAL_BASE_GYRO,
    GIMBAL_BASE_FORCE,
    GIMBAL_LINK_GYROS,
    GIMBAL_CHANNELS
};

/* When a sensor counts as failing. */
struct gimbal_limits {
    bool noisy;          /* gyros and accelerometer have noise: a reading that repeats itself is frozen */
    int held;            /* samples over which a failing reading is bridged; then the sensor is given up */
    int repeats;         /* equal readings in a row that count as frozen */
    int back;            /* good samples in a row after which a sensor that was given up is believed again */
    float moved;         /* rad that a joint moves by its gyros while its encoder stands: then that is frozen */
    float longest;       /* a longer step of the clock is the clock's own fault, s */
    float fastest;       /* no gyro reads more, rad/s */
    float farthest;      /* no encoder reads more, rad, and no joint's rate is more, rad/s */
    float strongest;     /* no accelerometer reads more, m/s^2 */
    float times;         /* a change so many times as large as any of late is a spike */
    float kept;          /* share of a change of late that is left a sample later */
    float first;         /* changes of late before there were any, in `least` */
    float least[GIMBAL_CHANNELS]; /* smaller changes are no spikes, rad, rad/s or m/s^2 */
    float smoothing;     /* time constant of rates from encoders, which stand in for a lost gyro, s */
    float steep;         /* largest entry of the camera's inverse Jacobian that is believed */
    float damping;       /* of the inverse beyond that */
};

struct gimbal_parameters {
    enum gimbal_law law;
    float dt;                                          /* sampling interval, s */
    uint32_t dt_us;                                    /* the same, microseconds */
    float gravity;                                     /* m/s^2 */
    float limit[GIMBAL_JOINTS];                        /* largest torque, N m */
    struct gimbal_loop tracking[GIMBAL_JOINTS];        /* loops that follow a reference */
    struct gimbal_loop holding[GIMBAL_JOINTS];         /* loops that hold the camera */
    struct gimbal_loop fallback[GIMBAL_JOINTS];        /* a PID for when an IMU is lost */
    struct gimbal_robust robust;
    struct gimbal_terms terms;
    struct gimbal_drive drive[GIMBAL_JOINTS];
    float still;                                       /* rate under which a reference stands, rad/s */
    float tracking_lead[GIMBAL_JOINTS];                /* from the sample to the middle of the torque's hold, s */
    float holding_lead[GIMBAL_LEADS];                  /* the same, one per distinct drive, s */
    int lead_of[GIMBAL_JOINTS];                        /* which of them is a joint's */
    float forecast[GIMBAL_LEADS][3][GIMBAL_TAPS];      /* base's rate, angular acceleration, force; newest first */
    float lasting;                                     /* share of a torque cut off that is owed a sample later */
    float most_owed;                                   /* largest torque owed, in torque limits */
    struct gimbal_judging judging;
    float fusion_gain;                                 /* of the gaps between gyros; 0: the camera's gyro alone */
    float fusion_share;                                /* of a gap in its slow part, per sample */
    float fusion_bound;                                /* rad; a faster change of a gap is no noise and ends the fusion */
    float level_span;                                  /* longest time over which the force's mean says where up is, samples */
    float level_eased;                                 /* time in which that comes in where one sample said it first, s */
    struct gimbal_pace pace;
    struct gimbal_limits limits;
};

extern const struct gimbal_parameters gimbal_default_parameters;
extern const struct gimbal_point gimbal_drive_points[];
extern const char *const gimbal_joint_names[GIMBAL_JOINTS];
extern const char *const gimbal_link_names[GIMBAL_LINKS]; /* links with a gyro between base and camera; "" for none */

/* --- Following a reference on a base that stands upright --------------------------------------------------------- */

struct gimbal_reference {
    float q[GIMBAL_JOINTS]; /* angles, rad */
    float v[GIMBAL_JOINTS]; /* rates, rad/s */
    float a[GIMBAL_JOINTS]; /* accelerations, rad/s^2 */
};

/* What the law remembers from sample to sample. */
struct gimbal_tracking {
    float integral[GIMBAL_JOINTS];     /* of the error, rad s */
    float acceleration[GIMBAL_JOINTS]; /* of the reference at the sample before, rad/s^2 */
    bool begun;                        /* whether there was a sample before */
    uint32_t refused;                  /* samples whose readings or torque were refused: none was given, and the law began anew */
};

void gimbal_tracking_start(struct gimbal_tracking *state);

/* One sample: time t since the start, s, measured angles and rates; writes the torques, finite and within the limits. */
void gimbal_tracking_step(const struct gimbal_parameters *p, struct gimbal_tracking *state, float t,
                          const float q[GIMBAL_JOINTS], const float v[GIMBAL_JOINTS],
                          const struct gimbal_reference *reference, float tau[GIMBAL_JOINTS]);

/* --- Holding the camera still on a base that moves --------------------------------------------------------------- */

/* One sample of every sensor. */
struct gimbal_sensors {
    uint32_t time_us;              /* stamp, microseconds; it may wrap around */
    float q[GIMBAL_JOINTS];        /* encoders, rad */
    float camera_gyro[3];          /* in the camera's frame, rad/s */
    float base_gyro[3];            /* in the base link's frame, rad/s */
    float base_force[3];           /* accelerometer of the base link, m/s^2 */
    float link_gyro[GIMBAL_LINKS][3]; /* of gimbal_link_names, each in its link's frame, rad/s; zero where none is */
};

/* Attitudes in one frame that is fixed to the earth and whose z points up, (w, x, y, z). */
struct gimbal_attitudes {
    float camera[4];
    float base[4];
    float wanted[4]; /* of the camera */
    float eased;     /* time in which the accelerometer's mean corrects where up is, s; 0: nothing does */
};

/* What the check of the sensors remembers. */
struct gimbal_guard {
    struct gimbal_sensors raw;       /* last sample as it came */
    struct gimbal_sensors good;      /* the same, checked */
    struct gimbal_sensors before;    /* that of the sample before it */
    int failing[GIMBAL_CHANNELS];    /* failing samples in a row */
    int repeating[GIMBAL_CHANNELS];  /* equal samples in a row */
    int healthy[GIMBAL_CHANNELS];    /* good samples in a row since a channel was given up; -1: it is not */
    float moved[GIMBAL_JOINTS];      /* by the gyros, since the encoder last changed, rad */
    float rates[GIMBAL_JOINTS];      /* joint rates, from the encoders where something fails, rad/s */
    float swings[GIMBAL_CHANNELS];   /* largest changes from sample to sample of late, rad, rad/s or m/s^2 */
};

/* An attitude that is integrated: a unit quaternion, and what its floats cannot hold. */
struct gimbal_attitude {
    float q[4];
    float rest[4];
};

/* What keeps the camera from looking as wanted. */
enum gimbal_obstacle {
    GIMBAL_NONE,
    GIMBAL_UNREACHED, /* its joints cannot turn it there */
    GIMBAL_STEEP,     /* it would be near a singular pose */
    GIMBAL_LIMIT      /* a joint reaches its limit before */
};

/* The way from where the camera looks at the start to where it shall look: q = goal + (s - 1) way on that base. */
struct gimbal_way {
    bool on;                  /* whether there is one left to go */
    float base[4];            /* attitude of the base at the start, in the wanted frame */
    float goal[GIMBAL_JOINTS]; /* angles at which the camera looks as wanted from there, rad */
    float way[GIMBAL_JOINTS]; /* from the first angles to those, rad */
    float rate;               /* largest ds/dt, 1/s */
    float ramp;               /* time in which it is reached, s */
    enum gimbal_obstacle obstacle; /* other than none: there is no way, the camera is held where it looked at the start */
};

/* Where up is, in the wanted frame. */
struct gimbal_upright {
    float up[3];    /* that direction as it was known at the start */
    float eased;    /* time in which it is corrected, s; 0: it is not */
    float samples;  /* how many the means are of */
    float means[9]; /* three means of the specific force beyond gravity, m/s^2 */
};

/* What the law remembers. */
struct gimbal_memory {
    float integral[GIMBAL_JOINTS]; /* rad s */
    float owed[GIMBAL_JOINTS];     /* torque that the limits took off, to be made up for, N m */
};

/* All that is remembered; plain data that may be copied. */
struct gimbal_holding {
    struct gimbal_guard guard;
    struct gimbal_memory memory;
    int64_t time_us;                        /* time of the last sample on an even clock */
    struct gimbal_way way;                  /* to the attitude that is wanted */
    struct gimbal_upright upright;
    struct gimbal_attitude attitude;        /* of the camera, in the frame that is wanted for it */
    float turning[3];                       /* camera's rate that was integrated last, rad/s */
    float v[GIMBAL_JOINTS];                 /* joint rates, rad/s */
    float tau[GIMBAL_JOINTS];               /* last torques, N m */
    struct gimbal_attitude others[GIMBAL_GYROS]; /* attitudes by the other gyros, the base's first, in the wanted frame */
    float other_rates[GIMBAL_GYROS][3];     /* their last rates, rad/s */
    float gaps[3 * GIMBAL_GYROS];           /* what they make of the camera's attitude beyond its own gyro, rad */
    float turn[3];                          /* what the camera's attitude is turned by, rad */
    float past[GIMBAL_TAPS][6];             /* ring of the base's last rates and forces */
    int newest;                             /* place of the newest in it */
    float due[GIMBAL_DUE][12];              /* acceleration and force foreseen, and held, oldest first */
    float slow_errors[12];                  /* of both, behind a low-pass */
    float scores[8];                        /* mean squares of both one's errors */
    float trust;                            /* share of the forecast that is used, 0 to 1 */
    float slow_gaps[3 * GIMBAL_GYROS];      /* gaps behind a low-pass, rad */
    bool apart;                             /* whether the gyros differ by more than noise: the camera's own is used */
    bool fallback;                          /* whether the PID is in force that needs no model */
    bool steep;                             /* whether the camera is near a singular pose */
    uint32_t limited;                       /* samples in a row at a torque limit */
    uint32_t refused;                       /* samples whose torque was no number: none was given */
    uint32_t unanswered;                    /* the same, in a row; after so many as are bridged everything begins anew */
    uint32_t distrusted;                    /* channels of which a reading was ever refused: bit k is channel k */
    uint32_t lost;                          /* channels that are given up: bit k is channel k */
};

/* Where the camera looks now, on a base that counts as level: for a gimbal that is to hold what it sees. */
void gimbal_attitudes_now(const float q[GIMBAL_JOINTS], struct gimbal_attitudes *out);

/* The same on a base whose tilt is what its accelerometer says, first in this sample, soon in the mean of all. */
void gimbal_attitudes_level(const struct gimbal_parameters *p, const struct gimbal_sensors *seen,
                            struct gimbal_attitudes *out);

/* Begin: the camera turns to where it is wanted, or is held where it looks if that is out of reach: see way.obstacle. */

void gimbal_holding_start(const struct gimbal_parameters *p, struct gimbal_holding *state,
                          const struct gimbal_sensors *seen, const struct gimbal_attitudes *known);

/* One sample; writes the torques, finite and within the limits. Without encoders and camera gyro they are zero. */
void gimbal_holding_step(const struct gimbal_parameters *p, struct gimbal_holding *state,
                         const struct gimbal_sensors *seen, float tau[GIMBAL_JOINTS]);

#endif
