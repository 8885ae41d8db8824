#ifndef FLEXIPORT_TYPES_H_
#define FLEXIPORT_TYPES_H_

#include <stddef.h>
#include <stdint.h>
#include <sys/types.h>
#include <unistd.h>  // flexiport's users call getopt() without including it

#define FLEXIPORT_EXPORT __attribute__((visibility("default")))

#endif
