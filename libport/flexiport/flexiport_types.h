#ifndef FLEXIPORT_TYPES_H_
#define FLEXIPORT_TYPES_H_

#include <stddef.h>
#include <stdint.h>
#include <sys/types.h>

#define FLEXIPORT_EXPORT __attribute__((visibility("default")))

#endif
