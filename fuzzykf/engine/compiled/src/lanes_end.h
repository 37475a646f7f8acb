/* What lanes_body.h has defined, and the kind of processor: included after the last body for it. */
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
#undef FK_IS_SIZED
#undef FK_WIDTH
