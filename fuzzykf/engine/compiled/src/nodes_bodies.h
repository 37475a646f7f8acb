/* The arithmetic on nodes for one kind of processor. */
#include "lanes_body.h"

#include "nodes_body.h"

#include "nodes_back_body.h"

#include "lanes_end.h"
