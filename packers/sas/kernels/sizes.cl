// How sizes on screen are told: logarithms to base 2.
#define STEPS 8   // per doubling
#define SIZES 128 // 2^0 to 2^(127/8), 60 000 pixels
