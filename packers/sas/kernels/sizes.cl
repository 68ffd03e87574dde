// The scale of sizes on screen, logarithms to base 2. The rule from pixels to steps is size_steps in footprint.cl.
#define STEPS 8   // per doubling
#define SIZES 128 // 2^0 to 2^(127/8), 60 000 pixels
