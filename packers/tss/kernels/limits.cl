// What forms are limited to.
#define LEVELS 64.0f    // the highest level a hardware tessellator takes
#define LONGEST 1023.0f // texels along a base, and along a side of a right triangle but for the last one
#define OVERSAMPLED -1  // as the kind of a form, which is the level of an L else
