/* Gives the joints of a Webots robot the inertia of their rotors. NOT RUN in Webots.
 *
 * Copied by `stiction export --to webots`; joints.h beside it is generated. Build it with `make`, WEBOTS_HOME set.
 *
 * Each joint gets an angular motor on its hinge's axis, whose target speed is the joint's rate before the step and whose
 * constraint force mixing is TIMESTEP / inertia. ODE solves  rate_after + CFM torque = target,  so that
 *
 *     torque = -inertia (rate_after - rate_before) / TIMESTEP
 */

#include <ode/ode.h>
#include <plugins/physics.h>
#include <stddef.h>

#include "joints.h"

/* Torque that no joint reaches [N m]: ODE wants a bound for a motor to be on. */
#define UNBOUNDED 1e10

static dJointID hinges[JOINTS];
static dJointID motors[JOINTS];
static int count = 0; /* motors that exist: none, or all */

/* Return the hinge between two bodies, NULL where there is none. */
static dJointID hinge_between(dBodyID parent, dBodyID child) {
  int i;
  for (i = 0; i < dBodyGetNumJoints(child); ++i) {
    const dJointID joint = dBodyGetJoint(child, i);
    if (dJointGetType(joint) == dJointTypeHinge &&
        (dJointGetBody(joint, 0) == parent || dJointGetBody(joint, 1) == parent))
      return joint;
  }
  return NULL;
}

/* Make a motor that holds a rotor of some inertia [kg m^2] on a hinge, between the same bodies in the same order. */
static dJointID rotor(dJointID hinge, double inertia) {
  const dBodyID first = dJointGetBody(hinge, 0), second = dJointGetBody(hinge, 1);
  const dJointID motor = dJointCreateAMotor(dBodyGetWorld(first), 0);
  dVector3 axis;
  dJointAttach(motor, first, second);
  dJointSetAMotorMode(motor, dAMotorUser);
  dJointSetAMotorNumAxes(motor, 1);
  dJointGetHingeAxis(hinge, axis);
  dJointSetAMotorAxis(motor, 0, 1, axis[0], axis[1], axis[2]); /* 1: it turns with the first body */
  dJointSetAMotorParam(motor, dParamFMax, UNBOUNDED);
  dJointSetAMotorParam(motor, dParamCFM, TIMESTEP / inertia);
  return motor;
}

/* Called when the world is loaded, and again after a reset, which calls the clean-up first. */
void webots_physics_init(void) {
  int i;
  for (i = 0; i < JOINTS; ++i) {
    const dBodyID parent = dWebotsGetBodyFromDEF(TABLE[i].parent);
    const dBodyID child = dWebotsGetBodyFromDEF(TABLE[i].child);
    hinges[i] = parent != NULL && child != NULL ? hinge_between(parent, child) : NULL;
    if (hinges[i] == NULL) {
      dWebotsConsolePrintf("rotor_inertia: no joint between %s and %s; NO joint has rotor inertia\n", TABLE[i].parent,
                           TABLE[i].child);
      return;
    }
  }
  for (i = 0; i < JOINTS; ++i)
    motors[i] = rotor(hinges[i], TABLE[i].inertia);
  count = JOINTS;
  dWebotsConsolePrintf("rotor_inertia: %d joints have rotor inertia\n", count);
}

/* Called before every physics step. */
void webots_physics_step(void) {
  int i;
  for (i = 0; i < count; ++i)
    dJointSetAMotorParam(motors[i], dParamVel, dJointGetHingeAngleRate(hinges[i]));
  if (count > 0)
    dWebotsSend(CHANNEL, &count, (int)sizeof(count));
}

/* Called before the world goes, and before it is reset; ODE's objects still exist. */
void webots_physics_cleanup(void) {
  int i;
  for (i = 0; i < count; ++i)
    dJointDestroy(motors[i]);
  count = 0;
}
