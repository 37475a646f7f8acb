/* The arithmetic on nodes for one kind of processor. */
#include "lanes_body.h"

#include "nodes_body.h"

#include "nodes_back_body.h"

#undef FK_STATES
#undef FK_V
#undef FK_B
#undef FK_AS_VECTORS
#undef FK_BLOCK_OF
#undef FK_CELL
#undef FK_DEPTH
#undef FK_SOURCES
#undef FK_ROW
#undef FK_AT
#undef FK_READ
#undef FK_NAME
#undef FK_TARGET
#undef FK_WIDTH
