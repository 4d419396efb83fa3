/* SPDX-License-Identifier: MIT */
/* The splitter of socketcand's text: from any state that it can be in, any character leads to such a state again, within
 * the element; so every stream of characters is taken, of any length. */
#include "socketcand/text.c"

void check_text_feed(text_splitter_t splitter, char c)
{
    __CPROVER_assume(splitter.length <= TEXT_ELEMENT_MAX);
    bool whole = text_feed(&splitter, c);
    __CPROVER_assert(splitter.length <= TEXT_ELEMENT_MAX, "the element has room for its end");
    __CPROVER_assert(!whole || splitter.element[splitter.length] == '\0', "a whole element is a string");
}
