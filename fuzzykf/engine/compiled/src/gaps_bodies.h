/* The arithmetic of gaps for one kind of processor. */
#include "lanes_body.h"

#include "gaps_body.h"

#include "lanes_end.h"
