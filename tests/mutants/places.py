"""Finds the places of a source where a mutant can be, in clang's syntax tree."""

import bisect
import dataclasses
import pathlib
import re

from clang import cindex
from clang.cindex import CursorKind as K
from clang.cindex import TypeKind

KINDS = {
    "left-out": "a statement is left out",
    "negated": "a condition, or a value of type bool that is returned, is negated",
    "always": "a branch is always taken: the condition, or a part of it, is true",
    "never": "a branch is never taken: the condition, or a part of it, is false; a loop's body never runs",
    "bound": "a bound is off by one: < becomes <=, > becomes >=, and the reverse",
    "constant": "a number, character, bool, enumerator or named constant becomes another one",
    "exchanged": "two arguments of one type are exchanged",
}

# Calls whose absence no test can notice, or whose text no test promises. README.md gives the reasons.
UNSEEN_CALLS = {"debug", "trace", "should_log", "reserve", "shrink_to_fit", "posix_fadvise", "madvise", "assert"}
# Calls whose arguments are not exchanged: it would change nothing, or not compile.
SYMMETRIC_CALLS = {"min", "max", "minmax", "swap", "iter_swap", "exchange"}

FUNCTIONS = {K.FUNCTION_DECL, K.CXX_METHOD, K.CONSTRUCTOR, K.DESTRUCTOR, K.CONVERSION_FUNCTION, K.FUNCTION_TEMPLATE}
HOLDERS = {K.NAMESPACE, K.STRUCT_DECL, K.CLASS_DECL, K.CLASS_TEMPLATE, K.LINKAGE_SPEC, K.UNEXPOSED_DECL,
           K.CLASS_TEMPLATE_PARTIAL_SPECIALIZATION}
LOOPS = {K.WHILE_STMT, K.FOR_STMT, K.DO_STMT, K.CXX_FOR_RANGE_STMT}
# Parts of the tree that only the compiler evaluates.
UNEVALUATED = {K.STATIC_ASSERT, K.TYPE_REF, K.TEMPLATE_REF, K.NAMESPACE_REF, K.CXX_UNARY_EXPR, K.SIZE_OF_PACK_EXPR,
               K.ENUM_DECL, K.CXX_TYPEID_EXPR, K.ASM_STMT, K.TYPE_ALIAS_DECL, K.TYPEDEF_DECL, K.USING_DECLARATION}
SKIPPED_OPERANDS = {K.DECL_REF_EXPR, K.MEMBER_REF_EXPR, K.OVERLOADED_DECL_REF}

RELATIONS = {"<": "<=", "<=": "<", ">": ">=", ">=": ">"}
INTEGER = re.compile(r"(0[xX][0-9a-fA-F']+|0[bB][01']+|[0-9][0-9']*)([uUlLzZ]*)$")
DURATION = re.compile(r"([0-9][0-9']*)(h|min|s|ms|us|ns)$")
ITERATOR = re.compile(r"\b(c?r?begin|data)\(\)$")  # exchanged with the end of its range: a crash that says little
CHARACTER = re.compile(r"'(.)'$")
ESCAPE = re.compile(r"'(\\.[0-7a-fA-F]*)'$")
OTHER_ESCAPE = {r"\n": r"\r", r"\r": r"\n", r"\0": r"\1", r"\t": " "}


@dataclasses.dataclass(frozen=True)
class Place:
    """One mutant. `start` and `end` are the offsets, in bytes, of what it replaces; `pieces` is the replacement: texts,
    in which @ is the switch, and ranges (start, end) of the source."""

    file: str
    line: int
    column: int
    kind: str
    start: int
    end: int
    pieces: tuple
    change: str  # for a person
    text: str  # of the line

    @property
    def is_statement(self):
        """Whether it replaces a statement; others replace an expression, which may be all there is of a statement."""
        return str(self.pieces[0]).startswith("if (")

    @property
    def key(self):
        return f"{self.file}:{self.line}:{self.column}:{self.kind}:{self.change}"

    def __str__(self):
        return f"{self.file}:{self.line}:{self.column}: {self.kind}: {self.change}"


def shown(text, most=60):
    text = " ".join(text.split())
    return text if len(text) <= most else text[:most - 2] + " …"


def increased(text):
    """Another number for the text of one: one more if it is small or a pattern of bits, otherwise twice as much."""
    match = INTEGER.match(text)
    if not match:
        return None
    digits, suffix = match.group(1).replace("'", "").lower(), match.group(2)
    if digits.startswith("0x"):
        return f"0x{int(digits, 16) + 1:x}{suffix}"
    if digits.startswith("0b"):
        return f"0b{int(digits, 2) + 1:b}{suffix}"
    if digits.startswith("0") and digits != "0":
        return f"0{int(digits, 8) + 1:o}{suffix}"
    value = int(digits)
    return f"{0 if value == 1 else value + 1 if value <= 16 else value * 2}{suffix}"


class Finder:
    """The places of one source."""

    def __init__(self, name, path, unit):
        self.name, self.unit = name, unit
        self.data = pathlib.Path(path).read_bytes()
        self.path = path
        self.starts = [0] + [n + 1 for n, byte in enumerate(self.data) if byte == 10]
        tokens = unit.get_tokens(extent=unit.get_extent(path, (0, len(self.data))))
        self.tokens = [(t.extent.start.offset, t.extent.end.offset, t.spelling) for t in tokens
                       if t.kind != cindex.TokenKind.COMMENT]
        self.token_starts = [token[0] for token in self.tokens]
        # Uses of macros with arguments. The preprocessor's record of them would take as long as the rest of the parse.
        self.macros = [self.group(begin) and (begin, self.group(begin)[1])
                       for index, (begin, _, text) in enumerate(self.tokens)
                       if re.match(r"[A-Z][A-Z0-9_]{2,}$|assert$", text) and self.token_text(index + 1) == "("]
        self.places, self.seen = [], set()

    def is_here(self, cursor):
        file = cursor.location.file
        return file is not None and file.name == self.path

    def find(self):
        for cursor in self.unit.cursor.get_children():
            if self.is_here(cursor):
                self.declaration(cursor)
        return self.places

    # Text and offsets.

    def text(self, start, end):
        return self.data[start:end].decode("utf-8", "replace")

    @staticmethod
    def span(cursor):
        return cursor.extent.start.offset, cursor.extent.end.offset

    def token_at(self, offset):
        """The index of the first token at or after that offset."""
        return bisect.bisect_left(self.token_starts, offset)

    def token_text(self, index):
        return self.tokens[index][2] if 0 <= index < len(self.tokens) else ""

    def in_macro(self, start, end):
        return any(first <= start and end <= last for first, last in self.macros)

    def is_within(self, cursor, outer):
        return self.span(outer)[0] <= cursor.extent.start.offset and cursor.extent.end.offset <= self.span(outer)[1]

    def group(self, offset):
        """The offsets of the parentheses that open first at or after that offset: before the (, after the )."""
        index = self.token_at(offset)
        while self.token_text(index) not in ("(", ""):
            index += 1
        first, depth = index, 0
        while index < len(self.tokens):
            depth += {"(": 1, ")": -1}.get(self.token_text(index), 0)
            if depth == 0:
                return self.tokens[first][0], self.tokens[index][1]
            index += 1
        return None

    def add(self, kind, start, end, pieces, change):
        if start >= end or self.in_macro(start, end) or (kind, start, end, change) in self.seen:
            return
        self.seen.add((kind, start, end, change))
        line = bisect.bisect_right(self.starts, start)
        text = self.data[self.starts[line - 1]:].split(b"\n", 1)[0].decode("utf-8", "replace").strip()
        self.places.append(Place(self.name, line, start - self.starts[line - 1] + 1, kind, start, end, tuple(pieces),
                                 change, text))

    # The tree.

    def declaration(self, cursor):
        if cursor.kind in HOLDERS:
            for child in cursor.get_children():
                self.declaration(child)
        elif cursor.kind in FUNCTIONS and cursor.is_definition() and not self.is_constant(cursor):
            for child in cursor.get_children():
                if child.kind == K.COMPOUND_STMT:
                    self.block(child, is_last_block=True)
                elif child.kind.is_expression():
                    self.expression(child, cursor)  # of a constructor's initialisers

    def is_constant(self, cursor):
        """Whether the declaration says constexpr, consteval or constinit."""
        index = self.token_at(cursor.extent.start.offset)
        while index < len(self.tokens) and self.tokens[index][0] < cursor.location.offset:
            if self.tokens[index][2] in ("constexpr", "consteval", "constinit"):
                return True
            index += 1
        return False

    def is_unseen(self, cursor):
        """A call that UNSEEN_CALLS names, in whatever wraps it."""
        while cursor.kind == K.UNEXPOSED_EXPR:
            children = list(cursor.get_children())
            if len(children) != 1:
                break
            cursor = children[0]
        if cursor.kind == K.CALL_EXPR and cursor.spelling in UNSEEN_CALLS:
            return True
        return self.text(*self.span(cursor)).startswith("(void)")

    def block(self, cursor, is_last_block=False):
        children = list(cursor.get_children())
        for index, child in enumerate(children):
            last = is_last_block and index == len(children) - 1
            self.statement(child, cursor, last)

    def statement(self, cursor, parent, last=False):
        kind = cursor.kind
        start, end = self.span(cursor)
        if kind == K.COMPOUND_STMT:
            self.block(cursor, last)
        elif kind.is_expression():
            if self.is_unseen(cursor):
                return
            self.leave_out(start, end)
            self.expression(cursor, parent)
        elif kind in (K.BREAK_STMT, K.CONTINUE_STMT):
            if not last:
                self.leave_out(start, end)
        elif kind == K.RETURN_STMT:
            children = list(cursor.get_children())
            if not children and not last:
                self.leave_out(start, end)
            for child in children:
                if child.type.get_canonical().kind == TypeKind.BOOL and child.kind != K.CXX_BOOL_LITERAL_EXPR:
                    self.negate(*self.span(child))
                self.expression(child, cursor)
        elif kind == K.IF_STMT:
            self.if_statement(cursor, last)
        elif kind in LOOPS:
            self.loop(cursor)
        elif kind == K.SWITCH_STMT:
            children = list(cursor.get_children())
            for child in children[:-1]:
                self.expression(child, cursor)
            self.statement(children[-1], cursor, last=True)
        elif kind in (K.CASE_STMT, K.DEFAULT_STMT):
            self.statement(list(cursor.get_children())[-1], cursor, last)
        elif kind == K.DECL_STMT:
            for child in cursor.get_children():
                self.local(child)
        elif kind in (K.CXX_TRY_STMT, K.CXX_CATCH_STMT, K.LABEL_STMT):
            for child in cursor.get_children():
                if child.kind.is_statement():
                    self.statement(child, cursor)
        else:  # another statement, as an empty one
            for child in cursor.get_children():
                self.expression(child, cursor)

    def leave_out(self, start, end):
        self.add("left-out", start, end, ["if (@) {} else ", (start, end)], f'without "{shown(self.text(start, end))}"')

    def local(self, cursor):
        """A declaration within a function."""
        if cursor.kind in HOLDERS:
            self.declaration(cursor)
            for child in cursor.get_children():
                if child.kind in FUNCTIONS:
                    self.declaration(child)
        elif cursor.kind == K.VAR_DECL and not self.is_constant(cursor):
            is_array = cursor.type.kind == TypeKind.CONSTANTARRAY
            for child in cursor.get_children():
                if child.extent.start.offset < cursor.location.offset:
                    continue  # of its type
                if is_array and child.kind != K.INIT_LIST_EXPR:
                    continue  # its bound
                self.expression(child, cursor)
        elif cursor.kind not in (K.VAR_DECL, K.TYPE_ALIAS_DECL, K.TYPEDEF_DECL, K.USING_DECLARATION):
            for child in cursor.get_children():
                if child.kind.is_expression():
                    self.expression(child, cursor)

    def if_statement(self, cursor, last):
        keyword = self.token_at(cursor.extent.start.offset)
        if self.token_text(keyword + 1) in ("constexpr", "consteval"):
            for child in list(cursor.get_children()):
                if child.kind.is_statement():
                    self.statement(child, cursor)
            return
        group = self.group(cursor.extent.start.offset)
        head = [c for c in cursor.get_children() if c.extent.start.offset < group[1]]
        branches = [c for c in cursor.get_children() if c.extent.start.offset >= group[1]]
        condition = head[-1] if head else None
        declared = [c for c in head if c.kind == K.VAR_DECL]
        if declared and self.is_within(condition, declared[-1]):  # if (auto x = …): the use of x has the place of its name
            condition = declared[-1]
            head = declared[-1:]
        if any(self.is_unseen(c) for c in head):
            return
        if condition is not None and condition.kind.is_expression():
            self.condition(condition, cursor)
            head = head[:-1]
        elif condition is not None and condition.kind == K.VAR_DECL:
            self.declared_condition(condition, group)
        for child in head:
            if child.kind == K.DECL_STMT:
                self.statement(child, cursor)
            elif child.kind == K.VAR_DECL:
                self.local(child)
        for branch in branches:
            self.statement(branch, cursor, last)

    def declared_condition(self, declared, group):
        """if (auto x = …): the declaration becomes the initialiser of the if, and x its condition."""
        start, end = declared.extent.start.offset, group[1] - 1
        name = declared.spelling
        if not name or self.text(start, end).count(";"):
            return
        whole = self.text(start, end)
        self.add("negated", start, end, [(start, end), f"; @ != static_cast<bool>({name})"], f'"{shown(whole)}" is negated')

    def loop(self, cursor):
        children = list(cursor.get_children())
        if not children:
            return
        if cursor.kind == K.DO_STMT:
            self.statement(children[0], cursor, last=True)
            self.condition(children[1], cursor, loop=True)
            return
        body = children[-1]
        group = self.group(cursor.extent.start.offset)
        head = children[:-1]
        first, second = self.separators(group) if cursor.kind == K.FOR_STMT else (None, None)
        for child in head:
            begin = child.extent.start.offset
            if any(each.kind == K.VAR_DECL and child != each and self.is_within(child, each) for each in head):
                continue  # while (auto x = …)
            if cursor.kind == K.WHILE_STMT and child.kind.is_expression():
                self.condition(child, cursor, loop=True)
            elif cursor.kind == K.FOR_STMT and first is not None and first < begin < second:
                self.condition(child, cursor, loop=True)
            elif child.kind == K.DECL_STMT:
                self.statement(child, cursor)
            elif child.kind == K.VAR_DECL:
                if cursor.kind != K.CXX_FOR_RANGE_STMT:
                    self.local(child)
            elif child.kind.is_expression():
                self.expression(child, cursor)
        if cursor.kind == K.CXX_FOR_RANGE_STMT:
            start, end = self.span(cursor)
            if self.text(start, start + 3) == "for":
                self.add("never", start, end, ["if (@) {} else ", (start, end)],
                         f'"{shown(self.text(start, group[1]))}" runs no round')
        self.statement(body, cursor, last=True)

    def separators(self, group):
        """The offsets of the two semicolons of a for."""
        depth, found = 0, []
        for begin, _, text in self.tokens[self.token_at(group[0]):self.token_at(group[1])]:
            depth += {"(": 1, "{": 1, "[": 1, ")": -1, "}": -1, "]": -1}.get(text, 0)
            if text == ";" and depth == 1:
                found.append(begin)
        return found if len(found) == 2 else (None, None)

    # Conditions.

    def negate(self, start, end):
        self.add("negated", start, end, ["(@ != static_cast<bool>(", (start, end), "))"],
                 f'"{shown(self.text(start, end))}" is negated')

    def condition(self, cursor, parent, loop=False):
        start, end = self.span(cursor)
        text = self.text(start, end)
        if text not in ("true", "false"):
            self.negate(start, end)
            self.force(start, end, always=not loop)
        self.expression(cursor, parent)

    def force(self, start, end, always=True):
        text = shown(self.text(start, end))
        if always:
            self.add("always", start, end, ["(@ || static_cast<bool>(", (start, end), "))"], f'"{text}" is true')
        self.add("never", start, end, ["(!@ && static_cast<bool>(", (start, end), "))"], f'"{text}" is false')

    def operator(self, cursor, children):
        """The operator of an expression with two operands, and where the second one begins."""
        if len(children) < 2 or children[0].extent.start.offset != cursor.extent.start.offset:
            return None, 0
        index = self.token_at(children[0].extent.end.offset)
        if index + 1 >= len(self.tokens) or self.tokens[index][1] > cursor.extent.end.offset:
            return None, 0
        return self.tokens[index][2], self.tokens[index + 1][0]

    # Expressions.

    def expression(self, cursor, parent):
        kind = cursor.kind
        if kind in UNEVALUATED:
            return
        start, end = self.span(cursor)
        if kind == K.LAMBDA_EXPR:
            for child in cursor.get_children():
                if child.kind == K.COMPOUND_STMT:
                    self.block(child, is_last_block=True)
                elif child.kind.is_expression() and child.kind not in SKIPPED_OPERANDS:
                    self.expression(child, cursor)
            return
        if kind.is_statement():
            self.statement(cursor, parent)
            return
        if kind.is_declaration():
            self.local(cursor)
            return
        if kind in (K.INTEGER_LITERAL, K.FLOATING_LITERAL, K.CHARACTER_LITERAL, K.CXX_BOOL_LITERAL_EXPR):
            self.literal(start)
            return
        if kind == K.DECL_REF_EXPR:
            self.named(cursor)
            return
        children = list(cursor.get_children())
        if kind == K.CONDITIONAL_OPERATOR and len(children) == 3:
            self.condition(children[0], cursor)
            children = children[1:]
        elif kind in (K.BINARY_OPERATOR, K.CALL_EXPR, K.UNEXPOSED_EXPR):
            name, second = self.operator(cursor, children)
            if name in ("&&", "||", "and", "or"):
                for operand in (self.span(children[0]), (second, end)):
                    self.negate(*operand)
                    self.force(*operand)
            elif name in RELATIONS and cursor.type.get_canonical().kind == TypeKind.BOOL:
                left, right, other = self.span(children[0]), (second, end), RELATIONS[name]
                self.add("bound", start, end,
                         ["(@ ? (", left, f") {other} (", right, ") : (", left, f") {name} (", right, "))"],
                         f'"{shown(self.text(start, end))}": {name} becomes {other}')
            elif name in ("==", "!=") and cursor.type.get_canonical().kind == TypeKind.BOOL:
                self.negate(start, end)
            elif kind == K.CALL_EXPR:
                if self.is_unseen(cursor):
                    return
                self.exchange(cursor)
        for child in children:
            if kind in SKIPPED_OPERANDS and child.kind in (K.INTEGER_LITERAL, K.CXX_BOOL_LITERAL_EXPR, K.DECL_REF_EXPR) \
                    and child.extent.start.offset > start:
                continue  # an argument of a template
            self.expression(child, cursor)

    def replace(self, start, end, changed):
        old = self.text(start, end)
        self.add("constant", start, end, [f"(@ ? {changed} : ", (start, end), ")"], f"{shown(old)} becomes {shown(changed)}")

    def literal(self, start):
        index = self.token_at(start)
        begin, end, text = self.tokens[index] if index < len(self.tokens) else (None, None, "")
        if begin != start:
            return
        changed = {"true": "false", "false": "true"}.get(text) or increased(text)
        if changed is None and DURATION.match(text):
            number, unit = DURATION.match(text).groups()
            changed = increased(number) + unit
        if changed is None and CHARACTER.match(text):
            letter = CHARACTER.match(text).group(1)
            following = chr(ord(letter) + 1) if letter.isalnum() and letter not in "zZ9" else "!" if letter == "?" else "?"
            changed = f"'{following}'"
        if changed is None and ESCAPE.match(text):
            changed = f"'{OTHER_ESCAPE.get(ESCAPE.match(text).group(1), '?')}'"
        if changed is None and re.match(r"[0-9.]+(e[-+]?[0-9]+)?$", text):
            changed = f"(2 * {text} + 1)"
        if changed is not None:
            self.replace(begin, end, changed)

    def named(self, cursor):
        referenced = cursor.referenced
        if referenced is None:
            return
        start, end = self.span(cursor)
        text = self.text(start, end)
        if referenced.kind == K.ENUM_CONSTANT_DECL and text.endswith(referenced.spelling):
            file = referenced.location.file
            if file is None or "/usr/" in file.name:
                return
            others = [c for c in referenced.semantic_parent.get_children() if c.kind == K.ENUM_CONSTANT_DECL]
            at = [c.spelling for c in others].index(referenced.spelling)
            following = [c for c in others[at + 1:] + others[:at] if c.enum_value != referenced.enum_value]
            if following:
                self.replace(start, end, text[:len(text) - len(referenced.spelling)] + following[0].spelling)
        elif referenced.kind == K.VAR_DECL and re.match(r"k[A-Z]\w*$", referenced.spelling):
            canonical = referenced.type.get_canonical()
            spelled = canonical.spelling.removeprefix("const ")
            number = canonical.kind in INTEGERS
            if number or spelled.startswith("std::chrono::duration<"):
                changed = f"static_cast<std::remove_cv_t<decltype({text})>>({text} * 2{' + 1' if number else ''})"
                self.add("constant", start, end, [f"(@ ? {changed} : ", (start, end), ")"],
                         f"{text} becomes {text} * 2{' + 1' if number else ''}")

    def exchange(self, cursor):
        """The whole call a second time, with the arguments exchanged: what the unchanged program does stays as it was."""
        start, end = self.span(cursor)
        arguments = [argument for argument in cursor.get_arguments() if argument is not None]
        if len(arguments) < 2 or cursor.spelling in SYMMETRIC_CALLS or cursor.spelling.startswith("operator"):
            return
        if cursor.referenced is None or cursor.referenced.kind in (K.CONSTRUCTOR, K.FUNCTION_TEMPLATE) \
                and cursor.referenced.spelling == cursor.type.get_canonical().get_declaration().spelling:
            # A constructor: only where its class is named, which is not so for variables and members.
            if not re.match(rf"(\w+::)*{re.escape(cursor.spelling)}\s*[({{]", self.text(start, end)) \
                    or self.token_text(self.token_at(start) - 1) == "new":
                return
        spans = [self.span(argument) for argument in arguments]
        for first in range(len(arguments)):
            for second in range(first + 1, min(first + 2, len(arguments))):
                one, two = arguments[first].type.get_canonical(), arguments[second].type.get_canonical()
                kinds = {one.spelling.removeprefix("const "), two.spelling.removeprefix("const ")}
                a, b = spans[first], spans[second]
                if len(kinds) != 1 or "dependent" in one.spelling or not start < a[0] < a[1] <= b[0] < b[1] < end:
                    continue
                texts = self.text(*a), self.text(*b)
                if texts[0] == texts[1] or "{" in (texts[0][0], texts[1][0]) or ITERATOR.search(texts[0]):
                    continue
                self.add("exchanged", start, end,
                         ["(@ ? ", (start, a[0]), b, (a[1], b[0]), a, (b[1], end), " : ", (start, end), ")"],
                         f'"{shown(texts[0], 30)}" and "{shown(texts[1], 30)}" are exchanged in '
                         f'"{shown(self.text(start, end))}"')


INTEGERS = {TypeKind.UCHAR, TypeKind.USHORT, TypeKind.UINT, TypeKind.ULONG, TypeKind.ULONGLONG, TypeKind.SCHAR,
            TypeKind.SHORT, TypeKind.INT, TypeKind.LONG, TypeKind.LONGLONG, TypeKind.CHAR_S}


def parse(path, arguments):
    """The syntax tree of a source; ValueError if clang cannot read it."""
    unit = cindex.Index.create().parse(path, args=arguments)
    errors = [str(each) for each in unit.diagnostics if each.severity >= cindex.Diagnostic.Error]
    if errors:
        raise ValueError(f"{path}: {errors[0]}")
    return unit


def find(name, path, arguments):
    """The places of the source `path`, which is `name` in the project, and the files that it includes."""
    unit = parse(path, arguments)
    return Finder(name, path, unit).find(), sorted({each.include.name for each in unit.get_includes()})


def rewritten(data, numbered):
    """The source `data` with these places [(number, Place)], which may hold one another. Lines stay where they are."""
    order = sorted(numbered, key=lambda each: (each[1].start, -each[1].end, not each[1].is_statement, each[0]))

    def render(start, end, edits):
        out, at = [], start
        while edits:
            number, place = edits[0]
            if place.start < at:  # overlaps what came before: cannot be, the tree's ranges hold one another
                edits = edits[1:]
                continue
            inner = [each for each in edits[1:] if each[1].start >= place.start and each[1].end <= place.end]
            out.append(data[at:place.start])
            for piece in place.pieces:
                if isinstance(piece, str):
                    out.append(piece.replace("@", f"::porttape_mutants::on({number})").encode())
                else:
                    out.append(render(*piece, [each for each in inner
                                               if each[1].start >= piece[0] and each[1].end <= piece[1]]))
            at = place.end
            edits = [each for each in edits[1:] if each[1].start >= at]
        out.append(data[at:end])
        return b"".join(out)

    return render(0, len(data), order)
